"""Checkpoints: one safetensors file that says what it holds; nothing of it is ever unpickled."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from seek_model.checkpoint_header import (
    FORMAT,
    BadCheckpoint,
    Header,
    Provenance,
    read_header,
)
from seek_model.config import Config, Model
from seek_model.network import Network

MOST_TABLES = 1_000_000_000  # bytes of what a network computes beside its weights when it is built
PART = ".part"  # ends the name of a file that is still being written


def weights(network: nn.Module) -> dict[str, Tensor]:
    """The tensors of a network by name, not copied; one that has several names comes once."""
    found: dict[tuple[int, torch.Size], str] = {}
    state = network.state_dict()
    for name, tensor in state.items():
        if tensor.numel():
            found.setdefault((tensor.data_ptr(), tensor.shape), name)
    names = set(found.values())
    return {name: one for name, one in state.items() if name in names or not one.numel()}


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """A file to write instead of `path`; it takes that name when it is whole and on disk."""
    part = path.with_name(path.name + PART)
    try:
        yield part
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def save(path: Path, tensors: Mapping[str, Tensor], config: Config, provenance: Provenance) -> None:
    """Writes a checkpoint, whole or not at all.

    Args:
        path: its file.
        tensors: by the names that `weights` gives.
        config: of the network that the tensors fit.
        provenance: where they come from.
    """
    metadata = {
        "format": FORMAT,
        "config": config.model_dump_json(),
        "provenance": provenance.model_dump_json(),
    }
    whole = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with written(path) as part:
        part.touch()
        mode = part.stat().st_mode  # the library would let nobody else read it
        save_file(whole, part, metadata)
        part.chmod(mode)


def halved(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same tensors with float16 for float32, which `load` widens again; others stay.

    Raises:
        ValueError: a value is none in float16; the message names its tensor.
    """
    found = {}
    for name, tensor in tensors.items():
        found[name] = tensor.half() if tensor.dtype == torch.float32 else tensor
        if found[name].is_floating_point() and not bool(torch.isfinite(found[name]).all()):
            most = float(tensor.abs().max())
            end = torch.finfo(torch.float16).max
            raise ValueError(f"tensor {name!r} holds {most:g}; float16 ends at {end:g}")
    return found


def load(path: Path) -> tuple[Network, Config, Header]:
    """The network of a checkpoint, in eval mode on the CPU, and what the file says of itself.

    No other file is needed: weights that the configuration names by path are in the checkpoint.
    Weights in half precision are widened.

    Raises:
        BadCheckpoint: the first thing that is wrong, as `read_header` and `fill` tell it.
        OSError: the file cannot be read.
    """
    header = read_header(path)
    model = self_contained(header.config.model)
    _require_parameters(model, header)
    network = Network(model)
    fill(network, load_file(path))
    return network.eval(), header.config, header


def _require_parameters(model: Model, header: Header) -> None:
    """Compares shapes before anything is allocated: a short header can ask for any size."""
    try:
        with torch.device("meta"):
            network = Network(model)
    except (ValueError, RuntimeError) as error:
        raise BadCheckpoint(f"config: no such network can be built: {error}") from None
    for name, parameter in network.named_parameters():
        shape = list(parameter.shape)
        if name not in header.tensors:
            raise BadCheckpoint(f"tensor {name!r} is missing: {_kind(parameter)}")
        if list(header.tensors[name].shape) != shape:
            found = list(header.tensors[name].shape)
            raise BadCheckpoint(f"tensor {name!r} is of shape {found}; expected {_kind(parameter)}")
    tables = sum(buffer.nbytes for buffer in network.buffers())
    if tables > MOST_TABLES:
        raise BadCheckpoint(
            f"config: its fixed tables would take {tables / 1e9:.1f} GB; at most "
            f"{MOST_TABLES / 1e9:.1f} are allowed. Fewer cells a view need less."
        )


def self_contained(model: Model) -> Model:
    """The same model without the paths of files that pretrained parts were read from."""
    language = model.language.model_copy(update={"weights": "", "vocabulary": ""})
    backbone = model.backbone
    if backbone.kind == "sam2":
        backbone = backbone.model_copy(update={"weights": ""})
    return model.model_copy(update={"language": language, "backbone": backbone})


@torch.no_grad()
def fill(
    network: nn.Module,
    tensors: Mapping[str, Tensor],
    may_miss: tuple[str, ...] = (),
) -> None:
    """Copies tensors into a network; all of them are checked before the first is copied.

    Where the network has float32 a tensor may be of float16, which is widened.

    Args:
        network: takes them.
        tensors: by the names that `weights` gives.
        may_miss: how names start whose tensors the network may keep as they are.

    Raises:
        BadCheckpoint: names the first tensor that is missing, unexpected, or of another shape
            or kind, or that holds NaN or an infinite value.
    """
    own = weights(network)
    for name, tensor in own.items():
        if name in tensors:
            _check(name, tensors[name], tensor)
        elif not name.startswith(may_miss):
            raise BadCheckpoint(f"tensor {name!r} is missing: {_kind(tensor)}")
    for name in tensors:
        if name not in own:
            raise BadCheckpoint(f"tensor {name!r} is unexpected: the network has none of that name")
    for name, tensor in tensors.items():
        own[name].copy_(tensor)


def _check(name: str, found: Tensor, expected: Tensor) -> None:
    widened = (found.dtype, expected.dtype) == (torch.float16, torch.float32)
    if found.shape != expected.shape or not (widened or found.dtype == expected.dtype):
        raise BadCheckpoint(f"tensor {name!r} is {_kind(found)}; expected {_kind(expected)}")
    if found.is_floating_point() and not bool(torch.isfinite(found).all()):
        bad = int((~torch.isfinite(found)).sum())
        raise BadCheckpoint(f"tensor {name!r}: {bad} of {found.numel()} values are NaN or infinite")


def _kind(tensor: Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} of shape {list(tensor.shape)}"
