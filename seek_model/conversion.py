"""Turns a file of torch.save into a checkpoint. Only to be run in a process that is closed.

Such a file is a pickle in a zip archive. `weights_only` takes nothing but tensors and plain values
from it; what that has missed before (CVE-2025-32434, CVE-2026-24747) is why it must be closed.
"""

import json
import zipfile
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save
from torch import Tensor

from seek_model.checkpoint_header import FORMAT, BadCheckpoint

PARTS = ("config", "provenance", "weights")
EXPECTED = (
    "expected a dictionary with config and provenance, as a checkpoint's header has them, and "
    "weights, tensors by name"
)
MOST_MEMBERS = 10_000
INFLATED = 1.1  # of the file's size, at most what its members take


def converted(path: Path) -> bytes:
    """The checkpoint with what a file of torch.save holds.

    Raises:
        BadCheckpoint: it is compressed, holds something else, or claims more than is there.
        OSError: it cannot be read.
    """
    _require_plain(path)
    try:
        held = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # whatever a crafted file provokes
        raise BadCheckpoint(f"it holds more than tensors: {_first_line(error)}") from None
    if not isinstance(held, dict) or set(held) != set(PARTS):
        raise BadCheckpoint(f"{EXPECTED}; found {_kind(held)}")
    metadata = {"format": FORMAT}
    metadata |= {name: _text(held[name], name) for name in ("config", "provenance")}
    return in_order(save(_tensors(held["weights"]), metadata))


def in_order(file: bytes) -> bytes:
    """The same safetensors file with its header sorted: the library's order is left to chance."""
    end = 8 + int.from_bytes(file[:8], "little")
    text = json.dumps(json.loads(file[8:end]), sort_keys=True, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + file[end:]


def _require_plain(path: Path) -> None:
    """Nothing is inflated: a small file could hold any number of zeros."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except zipfile.BadZipFile as error:
        raise BadCheckpoint(f"no file of torch.save: {error}") from None
    if len(members) > MOST_MEMBERS:
        raise BadCheckpoint(f"{len(members)} parts; at most {MOST_MEMBERS} are taken")
    if any(member.compress_type != zipfile.ZIP_STORED for member in members):
        raise BadCheckpoint("its parts are compressed; torch.save does not do that")
    if sum(member.file_size for member in members) > INFLATED * path.stat().st_size:
        raise BadCheckpoint("its parts claim more bytes than the file has")


def _text(value: Any, name: str) -> str:
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise BadCheckpoint(f"{name}: {error}; {EXPECTED}") from None


def _tensors(weights: Any) -> dict[str, Tensor]:
    if not isinstance(weights, dict) or not all(isinstance(name, str) for name in weights):
        raise BadCheckpoint(f"weights: {EXPECTED}; found {_kind(weights)}")
    for name, tensor in weights.items():
        if not isinstance(tensor, Tensor) or tensor.layout is not torch.strided:
            raise BadCheckpoint(f"tensor {name!r:.200}: {EXPECTED}; found {_kind(tensor)}")
        if not tensor.is_contiguous():
            raise BadCheckpoint(f"tensor {name!r:.200} is not contiguous; save its .contiguous()")
    return {name: tensor.detach().clone() for name, tensor in weights.items()}


def _kind(value: Any) -> str:
    if isinstance(value, dict):
        return f"a dictionary with {', '.join(map(repr, list(value)[:5])) or 'nothing'}"
    return type(value).__name__


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:300]
