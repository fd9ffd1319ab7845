"""Files of other formats are told apart, with the reason why they are not loaded."""

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from seek_model.checkpoint_header import BadCheckpoint, read_header
from seek_model.other_formats import named


def scripted(path: Path) -> None:
    with pytest.warns(DeprecationWarning):
        torch.jit.script(torch.nn.Linear(2, 2)).save(str(path))


def exported(path: Path) -> None:
    torch.export.save(torch.export.export(torch.nn.Linear(2, 2), (torch.zeros(1, 2),)), path)


def saved(path: Path) -> None:
    torch.save({"weight": torch.zeros(3)}, path)


def saved_long_ago(path: Path) -> None:
    torch.save({"weight": torch.zeros(3)}, path, _use_new_zipfile_serialization=False)


def pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps([1, 2]))


def onnx(path: Path) -> None:
    path.write_bytes(b"\x08\x08\x12\x04onnx:\x10")


FILES: list[tuple[Callable[[Path], None], str]] = [
    (scripted, "TorchScript"),
    (exported, "torch.export"),
    (saved, "a file of torch.save"),
    (saved_long_ago, "a pickle"),
    (pickled, "a pickle"),
    (onnx, "an ONNX model"),
    (lambda path: path.write_bytes(b"\x1f\x8b" + bytes(20)) and None, "a gzip archive"),
    (lambda path: path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(20)) and None, "an HDF5 file"),
]


@pytest.mark.parametrize(("write", "words"), FILES, ids=[words for _, words in FILES])
def test_a_file_of_another_format_is_named(
    tmp_path: Path, write: Callable[[Path], None], words: str
) -> None:
    path = tmp_path / "policy"
    write(path)

    assert words in (named(path) or "")
    with pytest.raises(BadCheckpoint, match=rf"{words}.*safetensors"):
        read_header(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"\x80", b"PK", b"a letter to the editor", b"\x80\x04" + bytes(6) + b'{"weight": {}}'],
)
def test_nothing_is_said_of_what_is_not_known(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "policy"
    path.write_bytes(content)

    assert named(path) is None
