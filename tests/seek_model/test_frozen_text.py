"""What the frozen readers share: they read once, never train, and live in a checkpoint."""

import copy

import pytest
import torch
from torch import Tensor, nn

from seek_model.frozen_text import ROOM, FrozenText
from seek_model.trunk import Words


class Lengths(FrozenText):
    """Reads an instruction as its length times a weight; its file is a word to leave out."""

    channels, most = 1, 1

    def __init__(self, file: bytes = b""):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(1), requires_grad=False)
        self.asked: list[str] = []
        if file:
            self.keep_source(file)

    def make_tokenizer(self, source: bytes) -> None:
        if not source:
            raise ValueError("no file")
        self.omitted = source.decode()

    def read(self, instructions: list[str]) -> Words:
        self.asked += instructions
        lengths = [len(text.replace(self.omitted, "")) for text in instructions]
        tokens = self.weight * torch.tensor(lengths, dtype=torch.float)[:, None, None]
        return Words(tokens, torch.ones(len(tokens), 1, dtype=torch.bool), tokens[:, 0])


def lengths(reader: FrozenText, *instructions: str) -> list[float]:
    pooled: Tensor = reader(instructions).pooled
    return pooled[:, 0].tolist()


def test_every_instruction_has_its_words_in_order() -> None:
    assert lengths(Lengths(b"the"), "push", "the cup", "push") == [4, 4, 4]


def test_an_instruction_is_read_once() -> None:
    reader = Lengths(b"the")

    for _ in range(2):
        lengths(reader, "push", "pull", "push")
    lengths(reader, "pull", "lift")

    assert reader.asked == ["push", "pull", "lift"]


def test_without_files_nothing_is_read() -> None:
    with pytest.raises(ValueError, match="no file"):
        lengths(Lengths(), "push")


def test_a_state_dict_brings_the_file_along() -> None:
    reader = Lengths()

    reader.load_state_dict(Lengths(b"cup").state_dict())

    assert lengths(reader, "a cup") == [2]


def test_tensors_filled_in_place_are_noticed() -> None:
    reader, other = Lengths(b"cup"), Lengths(b"a ")
    assert lengths(reader, "a cup") == [2]

    for name, tensor in reader.state_dict().items():
        tensor.copy_(other.state_dict()[name])

    assert lengths(reader, "a cup") == [3]


def test_a_copy_reads_on_its_own() -> None:
    reader = Lengths(b"cup")
    lengths(reader, "a cup")

    assert lengths(copy.deepcopy(reader), "a cup", "a") == [2, 1]


def test_words_read_in_inference_mode_serve_training() -> None:
    reader, scale = Lengths(b"the"), torch.ones(1, requires_grad=True)
    with torch.inference_mode():
        lengths(reader, "push")

    (reader(["push"]).tokens * scale).sum().backward()

    assert scale.grad is not None and scale.grad.item() == 4


def test_precision_does_not_depend_on_who_asked_first() -> None:
    reader = Lengths(b"the")

    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = reader(["push"])

    assert found.tokens.dtype == torch.float32


def test_a_file_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=f"{ROOM + 1} bytes; at most {ROOM} fit"):
        Lengths(b"x" * (ROOM + 1))
