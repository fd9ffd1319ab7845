"""openpi's messages: msgpack, with numpy arrays as maps of four byte keys.

The reader takes plain numbers alone. openpi's own makes an array of whatever type the peer names;
of type object that is a read through pointers that the peer chose.
Source: the wire of openpi-client 0.1.2, msgpack_numpy.
"""

import math
import re
from typing import Any

import msgpack
import numpy as np

MAX_MESSAGE = 4 * 2**20  # bytes; four views of 128 x 128 with depth take 0.5 MB
MOST_NODES = 10_000  # maps and lists of one message
MOST_AXES = 8
DTYPE = re.compile(r"^(\|b1|[<>|=]?[iu][1248]|[<>|=]?f[248])$")
ARRAY, SCALAR = b"__ndarray__", b"__npgeneric__"


class BadMessage(ValueError):
    """The bytes are no message that may be read."""


def pack(message: object) -> bytes:
    """A message of plain values and numeric arrays as openpi sends it.

    Raises:
        BadMessage: it holds something else, or is too large.
    """
    try:
        data: bytes = msgpack.packb(message, default=_packed)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise BadMessage(f"the message cannot be sent: {error}") from None
    if len(data) > MAX_MESSAGE:
        raise BadMessage(f"a message of {len(data)} bytes; at most {MAX_MESSAGE} are sent")
    return data


def _packed(value: object) -> Any:
    if isinstance(value, np.generic) and value.dtype.kind in "biuf":
        return {SCALAR: True, b"data": value.item(), b"dtype": value.dtype.str}
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        shape = list(value.shape)
        return {ARRAY: True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": shape}
    kind = f"array of {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
    raise TypeError(f"{kind} is neither a plain value nor a numeric array")


def unpack(data: bytes) -> dict[Any, Any]:
    """The message in bytes: a map of plain values and of arrays that own their memory.

    Raises:
        BadMessage: it is none, or holds what no message of ours may.
    """
    if len(data) > MAX_MESSAGE:
        raise BadMessage(f"a message of {len(data)} bytes; at most {MAX_MESSAGE} are read")
    reader = _Reader()
    try:
        message = msgpack.unpackb(data, object_hook=reader.on_map, list_hook=reader.on_list)
    except BadMessage:
        raise
    except (ValueError, TypeError, OverflowError, msgpack.UnpackException) as error:
        raise BadMessage(f"no msgpack: {str(error)[:200] or type(error).__name__}") from None
    if not isinstance(message, dict):
        raise BadMessage(f"the message is {type(message).__name__}; expected a map")
    return message


class _Reader:
    """Counts what it makes: four million empty maps fit into a message of four megabytes."""

    def __init__(self) -> None:
        self.nodes = 0

    def on_list(self, value: list[Any]) -> list[Any]:
        self.count()
        return value

    def on_map(self, value: dict[Any, Any]) -> Any:
        self.count()
        if ARRAY in value:
            return _array(value)
        if SCALAR in value:
            return _scalar(value)
        return value

    def count(self) -> None:
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise BadMessage(f"more than {MOST_NODES} maps and lists")


def _dtype(name: object) -> np.dtype[Any]:
    if not isinstance(name, str) or not DTYPE.fullmatch(name):
        raise BadMessage(f"an array of type {str(name)[:40]!r}; only plain numbers are read")
    return np.dtype(name)


def _array(value: dict[Any, Any]) -> np.ndarray[Any, Any]:
    dtype, shape, data = _dtype(value.get(b"dtype")), value.get(b"shape"), value.get(b"data")
    if not isinstance(shape, list) or len(shape) > MOST_AXES:
        raise BadMessage(f"an array of shape {str(shape)[:40]}")
    if any(type(length) is not int or not 0 <= length <= MAX_MESSAGE for length in shape):
        raise BadMessage(f"an array of shape {str(shape)[:40]}")
    if not isinstance(data, bytes) or len(data) != dtype.itemsize * math.prod(shape):
        size = len(data) if isinstance(data, bytes) else 0
        raise BadMessage(f"{size} bytes are no array of {dtype} with shape {shape}")
    return np.frombuffer(bytearray(data), dtype).reshape(shape)


def _scalar(value: dict[Any, Any]) -> Any:
    dtype, data = _dtype(value.get(b"dtype")), value.get(b"data")
    if not isinstance(data, bool | int | float):
        raise BadMessage(f"a number that is {type(data).__name__}")
    return dtype.type(data).item()
