"""Files of weights: both kinds, and errors that name what does not fit."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from seek_model.weight_files import fill, read_tensors


def tensors() -> dict[str, Tensor]:
    return {"weight": torch.arange(6.0).view(2, 3), "bias": torch.ones(2)}


@pytest.mark.parametrize("wrapper", ["", "model", "state_dict"])
def test_a_pickle_of_tensors_is_read(tmp_path: Path, wrapper: str) -> None:
    torch.save({wrapper: tensors(), "step": 3} if wrapper else tensors(), tmp_path / "a.pt")

    assert read_tensors(tmp_path / "a.pt").keys() == {"weight", "bias"}


def test_a_safetensors_file_is_read(tmp_path: Path) -> None:
    save_file(tensors(), tmp_path / "a.safetensors")

    assert torch.equal(read_tensors(tmp_path / "a.safetensors")["weight"], tensors()["weight"])


@pytest.mark.parametrize("name", ["a.pt", "a.safetensors"])
def test_what_is_no_file_of_weights_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"not weights at all")

    with pytest.raises(ValueError, match=r"cannot be read as weights .* Right would be"):
        read_tensors(tmp_path / name)


def test_code_in_a_pickle_is_not_run(tmp_path: Path) -> None:
    torch.save({"weight": Path("x")}, tmp_path / "a.pt")

    with pytest.raises(ValueError, match="cannot be read as weights"):
        read_tensors(tmp_path / "a.pt")


def test_a_list_is_no_state_dict(tmp_path: Path) -> None:
    torch.save([torch.ones(1)], tmp_path / "a.pt")

    with pytest.raises(ValueError, match="it holds a list"):
        read_tensors(tmp_path / "a.pt")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"weights at .*a\.pt"):
        read_tensors(tmp_path / "a.pt")


def test_fitting_tensors_fill_a_module_whatever_their_precision() -> None:
    layer = nn.Linear(3, 2)

    fill(layer, {name: value.half() for name, value in tensors().items()}, "a.pt")

    assert torch.equal(layer.weight, tensors()["weight"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"bias": None}, r"a\.pt has no tensor bias, which would be \(2,\)"),
        ({"bias": torch.ones(3)}, r"bias is \(3,\); right would be \(2,\)"),
        ({"scale": torch.ones(3)}, r"has a tensor scale, which belongs to nothing"),
    ],
)
def test_what_does_not_fit_is_named(change: dict[str, Tensor | None], said: str) -> None:
    found = {name: value for name, value in (tensors() | change).items() if value is not None}

    with pytest.raises(ValueError, match=said):
        fill(nn.Linear(3, 2), found, "a.pt")
