"""What a checkpoint says of itself, read without torch: the server looks before it loads.

A checkpoint is one safetensors file: eight bytes of length, a JSON header, then the tensors.
The header's metadata hold `format`, `config` and `provenance`.
"""

import json
import struct
from math import prod
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from seek_model import other_formats
from seek_model.config import Config

FORMAT = "hide-seek-checkpoint 1"
LONGEST = 10_000_000  # bytes of a header; ours have less than one
BYTES = {
    "BOOL": 1,
    "U8": 1,
    "I8": 1,
    "I16": 2,
    "U16": 2,
    "F16": 2,
    "BF16": 2,
    "I32": 4,
    "U32": 4,
    "F32": 4,
    "I64": 8,
    "U64": 8,
    "F64": 8,
}
MOST_DIMENSIONS = 8

_Checked = TypeVar("_Checked", bound=BaseModel)


class BadCheckpoint(ValueError):
    """The file is no checkpoint of ours; the message names the first mismatch."""


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Provenance(_Record):
    """Where the weights come from."""

    project: str  # version of hide-seek
    torch: str  # its version
    suite: str  # of the demonstrations
    version: int  # of that suite
    data: str  # hash of the keyframe store
    tasks: tuple[str, ...]
    phase: Literal["first", "second"]  # the last that was trained
    step: int = Field(ge=0)  # updates in that phase
    seed: int
    seconds: float = Field(ge=0)  # of training, over all phases and restarts
    start: str = ""  # SHA-256 of the file of `train.start`; empty: it started from scratch


class TensorInfo(_Record):
    """What the header tells of one tensor."""

    dtype: str
    shape: tuple[int, ...]


class Header(_Record):
    """A checkpoint without its weights."""

    config: Config
    provenance: Provenance
    tensors: dict[str, TensorInfo]

    @property
    def parameters(self) -> int:
        """Numbers in all tensors."""
        return sum(prod(tensor.shape) for tensor in self.tensors.values())


def read_header(source: Path | bytes) -> Header:
    """The header of a file, or of its bytes, checked against its size; no tensor is read.

    Raises:
        BadCheckpoint: the file is cut, is no safetensors file, or is no checkpoint of ours.
        OSError: it cannot be read.
    """
    if isinstance(source, bytes):
        start, size = source[: 8 + LONGEST], len(source)
        return _header(start[8 : 8 + _length(start[:8], size)], size)
    if known := other_formats.named(source):
        raise BadCheckpoint(f"this is {known}")
    with source.open("rb") as file:
        size = source.stat().st_size
        return _header(file.read(_length(file.read(8), size)), size)


def _length(start: bytes, size: int) -> int:
    """The header's, in bytes."""
    if len(start) < 8:
        raise BadCheckpoint(f"a file of {size} bytes cannot be a safetensors file")
    length = int(struct.unpack("<Q", start)[0])
    if length > LONGEST:
        raise BadCheckpoint(
            f"no safetensors file: its first 8 bytes give a header of {length} bytes, "
            f"and at most {LONGEST} are allowed"
        )
    if 8 + length > size:
        raise BadCheckpoint(f"the file ends within its header: {8 + length} bytes of {size}")
    return length


def _header(text: bytes, size: int) -> Header:
    entries = _parse(text, "the header")
    metadata = entries.pop("__metadata__", None)
    tensors = _tensors(entries, size - 8 - len(text))
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        found = metadata.get("format") if isinstance(metadata, dict) else None
        raise BadCheckpoint(f"metadata: format is {found!r:.80}; this version reads {FORMAT!r}")
    config, provenance = (_parse(metadata.get(key), key) for key in ("config", "provenance"))
    return Header(
        config=_valid(Config, config, "config"),
        provenance=_valid(Provenance, provenance, "provenance"),
        tensors=tensors,
    )


def _parse(text: Any, what: str) -> dict[str, Any]:
    if not isinstance(text, str | bytes):
        raise BadCheckpoint(f"metadata: {what} is missing; it is a JSON object, as text")
    try:
        document = json.loads(text, object_pairs_hook=_unique, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise BadCheckpoint(f"{what} is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise BadCheckpoint(f"{what} is {type(document).__name__}; it is a JSON object")
    return document


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for name, value in pairs:
        if name in entries:
            raise ValueError(f"{name!r:.200} comes twice")
        entries[name] = value
    return entries


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _valid(kind: type[_Checked], document: dict[str, Any], what: str) -> _Checked:
    try:
        return kind.model_validate_json(json.dumps(document))
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join((what, *map(str, fault["loc"])))
        raise BadCheckpoint(f"{place}: {fault['msg']}") from None


def _tensors(entries: dict[str, Any], size: int) -> dict[str, TensorInfo]:
    """All tensors; they lie one after the other and fill the file."""
    read = {name: _tensor(name, entry) for name, entry in entries.items()}
    end = 0
    for name, (_, start, stop) in sorted(read.items(), key=lambda item: item[1][1:]):
        if start != end:
            raise BadCheckpoint(
                f"tensor {name!r:.200} starts at byte {start}; the last ended at {end}"
            )
        end = stop
    if end != size:
        raise BadCheckpoint(f"the tensors take {end} bytes, but {size} follow the header")
    return {name: info for name, (info, _, _) in read.items()}


def _tensor(name: str, entry: Any) -> tuple[TensorInfo, int, int]:
    """What it is, and the bytes where it starts and ends, counted from the header's end."""
    if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "data_offsets"}:
        raise BadCheckpoint(f"tensor {name!r:.200}: expected dtype, shape and data_offsets")
    dtype, shape, offsets = entry["dtype"], entry["shape"], entry["data_offsets"]
    if not isinstance(dtype, str) or dtype not in BYTES:
        raise BadCheckpoint(
            f"tensor {name!r:.200}: unknown dtype {dtype!r:.40}; known: {', '.join(BYTES)}"
        )
    if not _whole(shape, MOST_DIMENSIONS) or not _whole(offsets, 2) or len(offsets) < 2:
        raise BadCheckpoint(
            f"tensor {name!r:.200}: expected as shape at most {MOST_DIMENSIONS} whole numbers "
            "from 0 on, and two as data_offsets"
        )
    start, stop = offsets
    size = prod(shape) * BYTES[dtype]
    if stop - start != size:
        raise BadCheckpoint(
            f"tensor {name!r:.200}: {dtype} of shape {shape} takes {size} bytes, "
            f"its offsets {start} to {stop} give {stop - start}"
        )
    return TensorInfo(dtype=dtype, shape=tuple(shape)), start, stop


def _whole(numbers: Any, most: int) -> bool:
    if not isinstance(numbers, list) or len(numbers) > most:
        return False
    return all(type(number) is int and number >= 0 for number in numbers)
