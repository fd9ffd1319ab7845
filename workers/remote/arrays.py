"""Messages in msgpack, and openpi's: numpy arrays are maps of four byte keys.

The reader takes plain numbers alone. openpi's own makes an array of whatever type the peer names;
of type object that is a read through pointers that the peer chose.
Source: the wire of openpi-client 0.1.2, msgpack_numpy.
"""

import math
import re
from collections.abc import Callable
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
    return write(message, _packed)


def write(message: object, packed: Callable[[object], Any]) -> bytes:
    """A message in msgpack, in which the function writes what msgpack cannot.

    Raises:
        BadMessage: it holds something else, for which the function raises a TypeError; or it is
            too large.
    """
    try:
        data: bytes = msgpack.packb(message, default=packed)
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
    raise no_number(value)


def no_number(value: object) -> TypeError:
    """What is raised for a value that is not written."""
    kind = f"array of {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
    return TypeError(f"{kind} is neither a plain value nor a numeric array")


def unpack(data: bytes) -> dict[Any, Any]:
    """The message in bytes: a map of plain values and of arrays that own their memory.

    Raises:
        BadMessage: it is none, or holds what no message of ours may.
    """
    return as_map(read(data, _openpi))


def as_map(message: object) -> dict[Any, Any]:
    """The message, if it is a map.

    Raises:
        BadMessage: it is none.
    """
    if not isinstance(message, dict):
        raise BadMessage(f"the message is {type(message).__name__}; expected a map")
    return message


def read(data: bytes, on_map: Callable[[dict[Any, Any]], Any]) -> Any:
    """The message in bytes of msgpack; the function says what a map stands for.

    Raises:
        BadMessage: it is none, or is too large.
    """
    if len(data) > MAX_MESSAGE:
        raise BadMessage(f"a message of {len(data)} bytes; at most {MAX_MESSAGE} are read")
    reader = Counting(on_map)
    try:
        return msgpack.unpackb(data, object_hook=reader.on_map, list_hook=reader.on_list)
    except BadMessage:
        raise
    except (ValueError, TypeError, OverflowError, msgpack.UnpackException) as error:
        raise BadMessage(f"no msgpack: {str(error)[:200] or type(error).__name__}") from None


class Counting:
    """Counts what is made: four million empty maps fit into a message of four megabytes."""

    def __init__(self, on_map: Callable[[dict[Any, Any]], Any]) -> None:
        self.nodes = 0
        self._on_map = on_map

    def on_list(self, value: list[Any]) -> list[Any]:
        self.count()
        return value

    def on_map(self, value: dict[Any, Any]) -> Any:
        self.count()
        return self._on_map(value)

    def count(self) -> None:
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise BadMessage(f"more than {MOST_NODES} maps and lists")


def _openpi(value: dict[Any, Any]) -> Any:
    if ARRAY in value:
        return array_of(value.get(b"dtype"), value.get(b"shape"), value.get(b"data"))
    if SCALAR in value:
        return _scalar(value)
    return value


def dtype_of(name: object) -> np.dtype[Any]:
    """The type of that name.

    Raises:
        BadMessage: it is none of plain numbers.
    """
    if not isinstance(name, str) or not DTYPE.fullmatch(name):
        raise BadMessage(f"an array of type {str(name)[:40]!r}; only plain numbers are read")
    return np.dtype(name)


def array_of(name: object, shape: object, data: object) -> np.ndarray[Any, Any]:
    """The array in bytes that a peer describes; it owns its memory.

    Raises:
        BadMessage: they are none of such a type and shape.
    """
    dtype = dtype_of(name)
    if not isinstance(shape, list) or len(shape) > MOST_AXES:
        raise BadMessage(f"an array of shape {str(shape)[:40]}")
    if any(type(length) is not int or not 0 <= length <= MAX_MESSAGE for length in shape):
        raise BadMessage(f"an array of shape {str(shape)[:40]}")
    if not isinstance(data, bytes) or len(data) != dtype.itemsize * math.prod(shape):
        size = len(data) if isinstance(data, bytes) else 0
        raise BadMessage(f"{size} bytes are no array of {dtype} with shape {shape}")
    return np.frombuffer(bytearray(data), dtype).reshape(shape)


def _scalar(value: dict[Any, Any]) -> Any:
    dtype, data = dtype_of(value.get(b"dtype")), value.get(b"data")
    if not isinstance(data, bool | int | float):
        raise BadMessage(f"a number that is {type(data).__name__}")
    return dtype.type(data).item()
