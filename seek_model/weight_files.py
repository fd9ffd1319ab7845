"""Tensors from published files, and modules that take them whole or say what does not fit."""

from collections.abc import Mapping
from pathlib import Path
from pickle import UnpicklingError

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

WRAPPERS = ("model", "state_dict")  # keys under which training code puts its tensors


def read_tensors(path: Path) -> dict[str, Tensor]:
    """The tensors of a .safetensors file, or of one that `torch.save` wrote, on the CPU.

    No code of the file is run: of a pickle only tensors are restored.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is of another kind, or damaged.
    """
    if not path.is_file():
        raise FileNotFoundError(f"No file of weights at {path}.")
    try:
        found = load_file(path) if path.suffix == ".safetensors" else _unpickled(path)
    except (SafetensorError, UnpicklingError, RuntimeError, EOFError, KeyError) as error:
        raise ValueError(
            f"{path} cannot be read as weights ({str(error).splitlines()[0]}). Right would be a "
            ".safetensors file, or a .pt file of tensors by name (a state dict, not TorchScript)."
        ) from error
    return {name: value for name, value in found.items() if isinstance(value, Tensor)}


def _unpickled(path: Path) -> dict[str, object]:
    found = torch.load(path, map_location="cpu", weights_only=True)
    for wrapper in WRAPPERS:
        if isinstance(found, dict) and isinstance(found.get(wrapper), dict):
            found = found[wrapper]
    if not isinstance(found, dict):
        raise RuntimeError(f"it holds a {type(found).__name__}")
    return found


def fill(module: nn.Module, tensors: Mapping[str, Tensor], source: str) -> None:
    """Put `tensors` into the parameters of the same names.

    Raises:
        ValueError: names the first parameter that is missing or of another shape, else the first
            tensor that belongs to none.
    """
    own = {name: value.shape for name, value in module.named_parameters()}
    for name, shape in own.items():
        if name not in tensors:
            raise ValueError(f"{source} has no tensor {name}, which would be {tuple(shape)}.")
        if tensors[name].shape != shape:
            raise ValueError(
                f"{source}: {name} is {tuple(tensors[name].shape)}; right would be {tuple(shape)}."
            )
    unexpected = next((name for name in tensors if name not in own), None)
    if unexpected is not None:
        raise ValueError(f"{source} has a tensor {unexpected}, which belongs to nothing here.")
    module.load_state_dict(dict(tensors), strict=False)  # buffers are not in such files
