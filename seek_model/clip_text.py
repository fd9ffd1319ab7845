"""CLIP's text encoder and its tokenizer, from files that the user has (Radford et al. 2021).

Parts carry OpenAI's names, so that a state dict of CLIP loads; what belongs to its image side is
left out. e instructions, l = 77 tokens, d channels.
"""

import gzip
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import torch
from einops import rearrange
from jaxtyping import Float, Int
from tokenizers import Regex, Tokenizer, normalizers, pre_tokenizers
from tokenizers.models import BPE
from torch import Tensor, nn

from seek_model.attention import attend
from seek_model.frozen_text import FrozenText
from seek_model.trunk import Words
from seek_model.weight_files import fill, read_tensors

HEAD = 64  # channels of a head
MERGES = 48_894  # of the published vocabulary, which are the first of the file
END_OF_WORD = "</w>"
SPECIAL = ("<|startoftext|>", "<|endoftext|>")
PARTS = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"  # of a text
TEXT = ("token_embedding.", "positional_embedding", "transformer.", "ln_final.")  # of CLIP


class Sizes(NamedTuple):
    """Of a text encoder."""

    width: int
    layers: int
    context: int
    vocabulary: int


RN50 = Sizes(width=512, layers=12, context=77, vocabulary=MERGES + 2 * 256 + len(SPECIAL))


class Attention(nn.Module):
    """Attention to the tokens before."""

    def __init__(self, width: int):
        super().__init__()
        self.heads = max(width // HEAD, 1)
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)

    def forward(self, x: Float[Tensor, "e l d"]) -> Float[Tensor, "e l d"]:
        qkv = nn.functional.linear(x, self.in_proj_weight, self.in_proj_bias)
        q, k, v = rearrange(qkv, "e l (three g c) -> three e g l c", three=3, g=self.heads)
        before = torch.ones(x.shape[1], x.shape[1], dtype=torch.bool, device=x.device).tril()
        found = attend(q, k, v, mask=before)
        out: Tensor = self.out_proj(rearrange(found, "e g l c -> e l (g c)"))
        return out


class Feedforward(nn.Module):
    """Two layers."""

    def __init__(self, width: int):
        super().__init__()
        self.c_fc = nn.Linear(width, 4 * width)
        self.c_proj = nn.Linear(4 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        x = self.c_fc(x)
        out: Tensor = self.c_proj(x * torch.sigmoid(1.702 * x))  # OpenAI's quick GELU
        return out


class Block(nn.Module):
    """One layer."""

    def __init__(self, width: int):
        super().__init__()
        self.ln_1, self.ln_2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attn, self.mlp = Attention(width), Feedforward(width)

    def forward(self, x: Float[Tensor, "e l d"]) -> Float[Tensor, "e l d"]:
        x = x + self.attn(self.ln_1(x))
        out: Tensor = x + self.mlp(self.ln_2(x))
        return out


class ClipText(FrozenText):
    """CLIP's token embeddings, those of RVT and its descendants; `pooled` is the last token's.

    Args:
        weights: a .safetensors or .pt state dict of CLIP, or of its text encoder alone. The
            sizes are read off it.
        vocabulary: OpenAI's bpe_simple_vocab_16e6.txt, or .txt.gz. Both or neither are given.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: only one file is given, or a file does not fit; tells what does not.
    """

    def __init__(self, weights: str = "", vocabulary: str = ""):
        super().__init__()
        if bool(weights) != bool(vocabulary):
            raise ValueError(
                "CLIP needs language.weights, its state dict, and language.vocabulary, "
                "bpe_simple_vocab_16e6.txt.gz; only one of them is given"
            )
        tensors = _text_only(read_tensors(Path(weights))) if weights else {}
        sizes = _sizes(tensors, weights) if weights else RN50
        self.channels, self.most = sizes.width, sizes.context
        self.token_embedding = nn.Embedding(sizes.vocabulary, sizes.width)
        self.positional_embedding = nn.Parameter(0.01 * torch.randn(sizes.context, sizes.width))
        blocks = nn.ModuleList(Block(sizes.width) for _ in range(sizes.layers))
        self.transformer = nn.ModuleDict({"resblocks": blocks})
        self.ln_final = nn.LayerNorm(sizes.width)
        self.requires_grad_(False)
        if weights:
            fill(self, tensors, weights)
            self.keep_source(_published(Path(vocabulary)))

    def make_tokenizer(self, source: bytes) -> None:
        if not source:
            raise ValueError("CLIP has no weights: set language.weights and language.vocabulary")
        units = _units(source)
        rows = self.token_embedding.num_embeddings
        if len(units) != rows:
            raise ValueError(
                f"the vocabulary has {len(units)} tokens, but CLIP's token_embedding has {rows} "
                "rows; right would be OpenAI's bpe_simple_vocab_16e6.txt.gz"
            )
        self._start, self._end = (units[token] for token in SPECIAL)
        self._tokenizer = _tokenizer(units, _merges(source))

    def rows_of(self, instruction: str) -> list[int]:
        """The vocabulary's rows of an instruction, start and end included."""
        spaced = " ".join(instruction.split())
        rows = self._tokenizer.encode(spaced, add_special_tokens=False).ids
        return [self._start, *rows[: self.most - 2], self._end]

    def read(self, instructions: list[str]) -> Words:
        sentences = [self.rows_of(text) for text in instructions]
        rows = torch.zeros(len(sentences), self.most, dtype=torch.long)
        for number, sentence in enumerate(sentences):
            rows[number, : len(sentence)] = torch.tensor(sentence)
        lengths = torch.tensor([len(sentence) for sentence in sentences])
        rows, lengths = rows.to(self.source.device), lengths.to(self.source.device)
        tokens = self._encode(rows)
        mask = torch.arange(self.most, device=rows.device) < lengths[:, None]
        pooled = tokens[torch.arange(len(tokens), device=rows.device), lengths - 1]
        return Words(tokens, mask, pooled)

    def _encode(self, rows: Int[Tensor, "e l"]) -> Float[Tensor, "e l d"]:
        x = self.token_embedding(rows) + self.positional_embedding
        for block in self.transformer["resblocks"].children():
            x = block(x)
        out: Tensor = self.ln_final(x)
        return out


def _text_only(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: value for name, value in tensors.items() if name.startswith(TEXT)}


def _sizes(tensors: Mapping[str, Tensor], source: str) -> Sizes:
    needed = "token_embedding.weight", "positional_embedding"
    for name in needed:
        if name not in tensors:
            raise ValueError(f"{source} has no tensor {name}; right would be a state dict of CLIP.")
    (vocabulary, width), (context, _) = (tensors[name].shape for name in needed)
    blocks = {name.split(".")[2] for name in tensors if name.startswith("transformer.resblocks.")}
    return Sizes(width, len(blocks), context, vocabulary)


# --- the vocabulary ---


def _published(path: Path) -> bytes:
    """The lines of the file that CLIP uses, unpacked."""
    if not path.is_file():
        raise FileNotFoundError(f"No vocabulary at {path}.")
    try:
        file = path.read_bytes()
        text = gzip.decompress(file) if path.suffix == ".gz" else file
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ValueError(f"{path} is damaged or no gzip file: {error}") from error
    return b"\n".join(text.splitlines()[: MERGES + 1])


def _merges(source: bytes) -> list[tuple[str, str]]:
    pairs = [line.split() for line in source.decode().split("\n")[1:] if line]
    wrong = next((pair for pair in pairs if len(pair) != 2), None)
    if wrong is not None:
        raise ValueError(f"the vocabulary has a line {wrong}; right would be two parts of a word")
    return [(first, second) for first, second in pairs]


def _units(source: bytes) -> dict[str, int]:
    """Tokens and their rows: bytes, bytes that end a word, merges, the two special ones."""
    letters = _letters()
    merged = [first + second for first, second in _merges(source)]
    tokens = [*letters, *(letter + END_OF_WORD for letter in letters), *merged, *SPECIAL]
    return {token: row for row, token in enumerate(tokens)}


def _letters() -> list[str]:
    """A printable character for every byte, in the order of OpenAI's table (GPT-2's)."""
    printable = [*range(ord("!"), ord("~") + 1), *range(ord("¡"), ord("¬") + 1)]
    printable += range(ord("®"), ord("ÿ") + 1)
    return [chr(code) for code in printable] + [chr(256 + n) for n in range(256 - len(printable))]


def _tokenizer(units: dict[str, int], merges: list[tuple[str, str]]) -> Tokenizer:
    tokenizer = Tokenizer(BPE(units, merges, end_of_word_suffix=END_OF_WORD))
    tokenizer.normalizer = normalizers.Sequence([normalizers.NFC(), normalizers.Lowercase()])
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Split(Regex(PARTS), behavior="removed", invert=True),
            pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
        ]
    )
    return tokenizer
