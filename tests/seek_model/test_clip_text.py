"""CLIP's text encoder with tiny random weights under OpenAI's names, and its tokenizer."""

import gzip
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from seek_model.clip_text import Attention, ClipText

MERGES = ["p u", "pu s", "pus h</w>", "t h", "th e</w>", "c a", "ca t</w>"]
ROWS = 512 + len(MERGES) + 2
START, END = ROWS - 2, ROWS - 1
PUSH, THE = 512 + MERGES.index("pus h</w>"), 512 + MERGES.index("th e</w>")
CONTEXT, WIDTH = 8, 16


def state(rows: int = ROWS, layers: int = 2) -> dict[str, Tensor]:
    """As OpenAI's CLIP has it, with some of its image side."""
    torch.manual_seed(0)
    block = {
        "ln_1.weight": (WIDTH,), "ln_1.bias": (WIDTH,), "ln_2.weight": (WIDTH,),
        "ln_2.bias": (WIDTH,), "attn.in_proj_weight": (3 * WIDTH, WIDTH),
        "attn.in_proj_bias": (3 * WIDTH,), "attn.out_proj.weight": (WIDTH, WIDTH),
        "attn.out_proj.bias": (WIDTH,), "mlp.c_fc.weight": (4 * WIDTH, WIDTH),
        "mlp.c_fc.bias": (4 * WIDTH,), "mlp.c_proj.weight": (WIDTH, 4 * WIDTH),
        "mlp.c_proj.bias": (WIDTH,),
    }  # fmt: skip
    shapes = {
        "token_embedding.weight": (rows, WIDTH), "positional_embedding": (CONTEXT, WIDTH),
        "ln_final.weight": (WIDTH,), "ln_final.bias": (WIDTH,), "text_projection": (WIDTH, 4),
        "logit_scale": (), "visual.conv1.weight": (4, 3, 3, 3),
    } | {
        f"transformer.resblocks.{layer}.{name}": shape
        for layer in range(layers)
        for name, shape in block.items()
    }  # fmt: skip
    return {name: 0.3 * torch.randn(shape) for name, shape in shapes.items()}


def files(folder: Path, tensors: dict[str, Tensor] | None = None) -> tuple[str, str]:
    weights, vocabulary = folder / "clip.safetensors", folder / "bpe.txt"
    save_file(state() if tensors is None else tensors, weights)
    vocabulary.write_text("#version: 0.2\n" + "\n".join(MERGES) + "\n")
    return str(weights), str(vocabulary)


def test_words_are_as_long_as_the_context_and_the_mask_ends_with_the_last_token(
    tmp_path: Path,
) -> None:
    reader = ClipText(*files(tmp_path))

    words = reader(["push the cat", "push"])

    assert reader.channels == WIDTH
    assert words.tokens.shape == (2, CONTEXT, WIDTH)
    assert words.mask.sum(dim=1).tolist() == [5, 3]
    assert words.mask[1, :3].all()
    assert torch.equal(words.pooled[1], words.tokens[1, 2])


def test_text_becomes_rows_of_the_vocabulary(tmp_path: Path) -> None:
    reader = ClipText(*files(tmp_path))

    assert reader.rows_of("Push  the\n") == [START, PUSH, THE, END]
    assert reader.rows_of("push!") == [START, PUSH, 256 + ord("!") - ord("!"), END]
    assert reader.rows_of("") == [START, END]
    assert reader.rows_of("th") == [START, ord("t") - ord("!"), 256 + ord("h") - ord("!"), END]


def test_a_long_text_is_cut_and_still_ends(tmp_path: Path) -> None:
    rows = ClipText(*files(tmp_path)).rows_of("push " * 20)

    assert rows == [START, *[PUSH] * (CONTEXT - 2), END]


def test_a_packed_vocabulary_is_the_same(tmp_path: Path) -> None:
    weights, plain = files(tmp_path)
    packed = tmp_path / "bpe.txt.gz"
    packed.write_bytes(gzip.compress(Path(plain).read_bytes()))

    assert torch.equal(
        ClipText(weights, str(packed))(["push the"]).tokens,
        ClipText(weights, plain)(["push the"]).tokens,
    )


def test_weights_may_be_a_pickle_of_tensors(tmp_path: Path) -> None:
    weights, vocabulary = files(tmp_path)
    torch.save(state(), tmp_path / "clip.pt")

    assert torch.equal(
        ClipText(str(tmp_path / "clip.pt"), vocabulary)(["push"]).tokens,
        ClipText(weights, vocabulary)(["push"]).tokens,
    )


def test_an_embedding_depends_only_on_the_tokens_before(tmp_path: Path) -> None:
    reader = ClipText(*files(tmp_path))

    push, both = reader(["push the", "push cat"]).tokens

    torch.testing.assert_close(push[:2], both[:2])
    assert (push[2:] - both[2:]).abs().amax(dim=1).min() > 1e-4


def test_attention_is_torchs_with_a_causal_mask() -> None:
    torch.manual_seed(0)
    ours, theirs = Attention(128), nn.MultiheadAttention(128, 2, batch_first=True)
    ours.load_state_dict(theirs.state_dict())
    x = torch.randn(3, 5, 128)
    later = torch.ones(5, 5, dtype=torch.bool).triu(1)

    expected, _ = theirs(x, x, x, attn_mask=later, need_weights=False)

    torch.testing.assert_close(ours(x), expected)


def test_nothing_of_it_is_trained(tmp_path: Path) -> None:
    reader = ClipText(*files(tmp_path))

    assert not any(parameter.requires_grad for parameter in reader.parameters())
    assert not reader(["push"]).tokens.requires_grad


def test_a_state_dict_is_all_that_it_takes(tmp_path: Path) -> None:
    reader = ClipText(*files(tmp_path))
    other = ClipText(*files(tmp_path, {k: v + 1 for k, v in state().items()}))

    other.load_state_dict(reader.state_dict())

    assert torch.equal(other(["push the"]).tokens, reader(["push the"]).tokens)


def test_the_published_sizes_need_no_file() -> None:
    with torch.device("meta"):
        reader = ClipText()

    assert (reader.channels, reader.most) == (512, 77)
    assert reader.token_embedding.weight.shape == (49408, 512)
    assert sum(p.numel() for p in reader.parameters()) == pytest.approx(63.2e6, rel=0.001)


def test_one_file_alone_is_refused(tmp_path: Path) -> None:
    weights, _ = files(tmp_path)

    with pytest.raises(ValueError, match="only one of them is given"):
        ClipText(weights)


def test_a_vocabulary_of_another_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"has {ROWS} tokens, but .* has {ROWS + 5} rows"):
        ClipText(*files(tmp_path, state(rows=ROWS + 5)))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("token_embedding.weight", None, "no tensor token_embedding.weight; right would be"),
        ("ln_final.bias", None, "no tensor ln_final.bias"),
        ("transformer.resblocks.0.ln_1.bias", torch.ones(3), r"is \(3,\); right would be \(16,\)"),
        ("transformer.resblocks.1.x", torch.ones(3), "resblocks.1.x, which belongs to nothing"),
    ],
)
def test_what_does_not_fit_is_named(
    tmp_path: Path, name: str, value: Tensor | None, said: str
) -> None:
    found = {k: v for k, v in (state() | {name: value}).items() if v is not None}

    with pytest.raises(ValueError, match=said):
        ClipText(*files(tmp_path, found))


@pytest.mark.parametrize(
    ("name", "file", "said"),
    [
        ("bpe.txt.gz", b"plain", "no gzip file"),
        ("bpe.txt", b"#version\np u s h\n", "right would be two parts"),
    ],
)
def test_a_damaged_vocabulary_is_refused(tmp_path: Path, name: str, file: bytes, said: str) -> None:
    weights, _ = files(tmp_path)
    (tmp_path / name).write_bytes(file)

    with pytest.raises(ValueError, match=said):
        ClipText(weights, str(tmp_path / name))


def test_a_missing_vocabulary_is_named(tmp_path: Path) -> None:
    weights, _ = files(tmp_path)

    with pytest.raises(FileNotFoundError, match=r"No vocabulary at .*none\.txt"):
        ClipText(weights, str(tmp_path / "none.txt"))
