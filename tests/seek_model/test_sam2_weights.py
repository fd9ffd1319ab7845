"""Files with Meta's names load whole, or say what does not fit."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from seek_model.hiera import VARIANTS
from seek_model.sam2_encoder import Sam2Encoder
from seek_model.sam2_weights import load_encoder

OTHERS = {
    "maskmem_tpos_enc": torch.zeros(7, 1, 1, 64),
    "sam_mask_decoder.iou_token.weight": torch.zeros(1, 256),
    "memory_encoder.out_proj.weight": torch.zeros(64, 256, 1, 1),
}  # of a whole SAM 2.1, and not needed here


def encoder(seed: int) -> Sam2Encoder:
    torch.manual_seed(seed)
    return Sam2Encoder(VARIANTS["toy"], image=32)


def published() -> dict[str, Tensor]:
    """As Meta's files have it, in the size of a toy."""
    own = encoder(1).state_dict()
    encoded = {name: value for name, value in own.items() if name.startswith("image_encoder.")}
    skips = {f"sam_mask_decoder.{k}": v for k, v in own.items() if k.startswith("conv_s")}
    return encoded | skips | OTHERS


@pytest.mark.parametrize("kind", ["pt", "safetensors"])
def test_a_published_file_loads(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"sam2.1.{kind}"
    if kind == "pt":
        torch.save({"model": published()}, path)
    else:
        save_file(published(), path)
    network, expected = encoder(2), encoder(1)

    load_encoder(network, path)

    for name, value in expected.state_dict().items():
        assert torch.equal(network.state_dict()[name], value), name


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("image_encoder.trunk.pos_embed", None, r"has no tensor image_encoder\.trunk\.pos_embed"),
        ("sam_mask_decoder.conv_s1.bias", None, r"has no tensor conv_s1\.bias"),
        ("image_encoder.trunk.blocks.9.proj.bias", torch.ones(1), "blocks.9.proj.bias, which bel"),
        ("image_encoder.neck.convs.0.conv.bias", torch.ones(5), r"is \(5,\); right would be \(32,"),
    ],
)
def test_what_does_not_fit_is_named(
    tmp_path: Path, name: str, value: Tensor | None, said: str
) -> None:
    found = {k: v for k, v in (published() | {name: value}).items() if v is not None}
    save_file(found, tmp_path / "sam2.1.safetensors")

    with pytest.raises(ValueError, match=said):
        load_encoder(encoder(2), tmp_path / "sam2.1.safetensors")


def test_nothing_is_filled_when_something_does_not_fit(tmp_path: Path) -> None:
    save_file(published() | {"image_encoder.x": torch.ones(1)}, tmp_path / "a.safetensors")
    network, before = encoder(2), encoder(2).state_dict()

    with pytest.raises(ValueError):
        load_encoder(network, tmp_path / "a.safetensors")

    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())
