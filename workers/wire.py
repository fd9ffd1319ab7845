"""Messages between a simulator process and a policy process: msgpack with its length in front.

Arrays travel as raw bytes with their type and shape. Nothing is unpickled, so a message can do no
more than be wrong.
"""

import math
import socket
import struct
import time
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from hide_tasks.contract import CameraView, Observation

MAX_MESSAGE = 64 * 2**20  # bytes; an observation takes 0.5 MB
ARRAY = 1  # msgpack's extension code
KINDS = "biuf"  # booleans and numbers, as numpy abbreviates them
HEADER = struct.Struct(">I")


class WireError(ValueError):
    """A message that is not one."""


def encode(message: object) -> bytes:
    """A message of plain values and numeric arrays as bytes.

    Raises:
        WireError: it holds something else, or is too large.
    """
    try:
        data: bytes = msgpack.packb(message, default=_pack_array)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise WireError(f"The message cannot be sent: {error}.") from None
    if len(data) > MAX_MESSAGE:
        raise WireError(f"The message has {len(data)} bytes; at most {MAX_MESSAGE} are sent.")
    return data


def decode(data: bytes) -> Any:
    """The message in bytes; arrays own their memory.

    Raises:
        WireError: the bytes are no message.
    """
    try:
        return msgpack.unpackb(data, ext_hook=_unpack_array)
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise WireError(f"Not a message: {error or type(error).__name__}.") from None


def _pack_array(value: object) -> Any:
    if isinstance(value, np.generic):
        value = np.asarray(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in KINDS:
        kind = f"array of {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
        raise TypeError(f"{kind} is neither a plain value nor a numeric array")
    content = (value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes())
    return msgpack.ExtType(ARRAY, msgpack.packb(content))


def _unpack_array(code: int, data: bytes) -> NDArray[Any]:
    if code != ARRAY:
        raise WireError(f"extension {code} is unknown; expected {ARRAY}, an array")
    name, shape, content = msgpack.unpackb(data)
    dtype = np.dtype(name)
    if dtype.kind not in KINDS or dtype.itemsize * math.prod(shape) != len(content):
        raise WireError(f"{len(content)} bytes are no array of {dtype} with shape {tuple(shape)}")
    return np.frombuffer(bytearray(content), dtype).reshape(shape)


def send(connection: socket.socket, message: object) -> None:
    """Sends a message; the connection's own time-out holds for it."""
    data = encode(message)
    connection.sendall(HEADER.pack(len(data)) + data)


def receive(connection: socket.socket, *, within: float | None = None) -> Any:
    """The next message.

    Args:
        within: seconds to wait for all of it; None waits for ever.

    Raises:
        EOFError: the other side is gone.
        TimeoutError: it did not come in time.
        WireError: the bytes are no message.
    """
    deadline = None if within is None else time.monotonic() + within
    (size,) = HEADER.unpack(_receive_bytes(connection, HEADER.size, deadline))
    if size > MAX_MESSAGE:
        raise WireError(f"A message of {size} bytes was announced; at most {MAX_MESSAGE} are read.")
    return decode(_receive_bytes(connection, size, deadline))


def _receive_bytes(connection: socket.socket, size: int, deadline: float | None) -> bytes:
    data = bytearray()
    while len(data) < size:
        connection.settimeout(_time_left(deadline))
        part = connection.recv(min(size - len(data), 2**20))
        if not part:
            raise EOFError("The other process closed the connection.")
        data += part
    return bytes(data)


def _time_left(deadline: float | None) -> float | None:
    if deadline is None:
        return None
    left = deadline - time.monotonic()
    if left <= 0:
        raise TimeoutError
    return left


def pack_observation(observation: Observation) -> dict[str, Any]:
    """An observation as a message: its fields and nothing else."""
    views = {
        name: {
            "rgb": view.rgb,
            "depth": view.depth,
            "intrinsics": view.intrinsics,
            "camera_to_world": view.camera_to_world,
        }
        for name, view in observation.views.items()
    }
    return {
        "views": views,
        "gripper_pose": observation.gripper_pose,
        "gripper_opening": float(observation.gripper_opening),
        "joint_positions": observation.joint_positions,
        "instruction": observation.instruction,
    }


def unpack_observation(message: dict[str, Any]) -> Observation:
    """The observation in a message."""
    views = {name: CameraView(**view) for name, view in message["views"].items()}
    return Observation(**{**message, "views": views})
