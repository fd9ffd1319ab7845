"""Files of torch.save become checkpoints in a closed process, or are refused with the reason."""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from seek_model.checkpoint_header import read_header
from tests.seek_model.checkpoints import parts_of, tiny_checkpoint
from workers.conversion import convert
from workers.policies import BadPolicy, Surroundings
from workers.sandbox.choice import chosen

MOST = 2**30


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_checkpoint(tmp_path_factory.mktemp("tiny") / "tiny.safetensors")


def convert_here(saved: Path, into: Path, most: int = MOST) -> None:
    convert(saved, into, Surroundings(sandbox=chosen()), most=most)


def test_a_file_of_torch_save_becomes_the_same_checkpoint(original: Path, tmp_path: Path) -> None:
    from safetensors.torch import load_file

    torch.save(parts_of(original), tmp_path / "saved.pt")
    convert_here(tmp_path / "saved.pt", tmp_path / "converted.safetensors")

    assert read_header(tmp_path / "converted.safetensors") == read_header(original)
    one, two = load_file(original), load_file(tmp_path / "converted.safetensors")
    assert all(torch.equal(one[name], two[name]) for name in one)


class Touches:
    """Unpickled, it would write a file."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (str(self.path),)


def compressed(saved: Path, parts: dict[str, Any]) -> None:
    torch.save(parts, saved.with_suffix(".plain"))
    with (
        zipfile.ZipFile(saved.with_suffix(".plain")) as plain,
        zipfile.ZipFile(saved, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for member in plain.infolist():
            archive.writestr(member.filename, plain.read(member))


def claims_much(saved: Path, parts: dict[str, Any]) -> None:
    huge = torch.zeros(1).expand(1_000_000, 1_000_000)
    torch.save({**parts, "weights": {"huge": huge}}, saved)


WRONG: dict[str, tuple[Callable[[Path, dict[str, Any]], None], str]] = {
    "runs code": (
        lambda saved, parts: torch.save({**parts, "config": Touches(saved.parent / "ran")}, saved),
        "more than tensors",
    ),
    "compressed": (compressed, "are compressed"),
    "claims much": (claims_much, "not contiguous"),
    "weights alone": (lambda saved, parts: torch.save(parts["weights"], saved), "found a dict"),
    "a list": (lambda saved, _: torch.save([1], saved), "found list"),
    "no tensors": (
        lambda saved, parts: torch.save({**parts, "weights": {"a": 1}}, saved),
        "found int",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_holds_no_checkpoint_is_refused(original: Path, tmp_path: Path, wrong: str) -> None:
    write, words = WRONG[wrong]
    write(tmp_path / "saved.pt", parts_of(original))

    with pytest.raises(BadPolicy, match=words):
        convert_here(tmp_path / "saved.pt", tmp_path / "converted.safetensors")
    assert not (tmp_path / "ran").exists()
    assert not (tmp_path / "converted.safetensors").exists()


def test_more_than_is_taken_is_refused(original: Path, tmp_path: Path) -> None:
    torch.save(parts_of(original), tmp_path / "saved.pt")

    with pytest.raises(BadPolicy, match="at most 10 are taken"):
        convert_here(tmp_path / "saved.pt", tmp_path / "converted.safetensors", most=10)
    assert not (tmp_path / "converted.safetensors").exists()
