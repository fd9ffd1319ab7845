"""Messages of OpenVLA's servers: JSON, with numpy arrays as maps of __numpy__, dtype and shape.

Source: json-numpy 2.1.
"""

import base64
import binascii
import json
from typing import Any

import numpy as np

from workers.remote.arrays import (
    MAX_MESSAGE,
    MOST_AXES,
    BadMessage,
    Counting,
    array_of,
    no_number,
)

ARRAY = "__numpy__"


def pack(message: object) -> bytes:
    """A message of plain values and numeric arrays.

    Raises:
        BadMessage: it holds something else, or is too large.
    """
    try:
        data = json.dumps(message, default=_packed, allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise BadMessage(f"the message cannot be sent: {error}") from None
    if len(data) > MAX_MESSAGE:
        raise BadMessage(f"a message of {len(data)} bytes; at most {MAX_MESSAGE} are sent")
    return data


def _packed(value: object) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        data = base64.b64encode(value.tobytes()).decode()
        return {ARRAY: data, "dtype": value.dtype.str, "shape": list(value.shape)}
    raise no_number(value)


def unpack(data: bytes) -> Any:
    """The message in bytes: plain values, and arrays that own their memory.

    Raises:
        BadMessage: it is none, or holds what no message of ours may.
    """
    if len(data) > MAX_MESSAGE:
        raise BadMessage(f"a message of more than {MAX_MESSAGE} bytes")
    reader = Counting(_on_map)
    try:
        return json.loads(data, object_hook=reader.on_map)
    except BadMessage:
        raise
    except (ValueError, RecursionError) as error:
        raise BadMessage(f"no JSON: {str(error)[:200]}") from None


def _on_map(value: dict[str, Any]) -> Any:
    if ARRAY not in value:
        return value
    try:
        data = base64.b64decode(value[ARRAY], validate=True)
    except (TypeError, ValueError, binascii.Error):
        raise BadMessage("an array whose data is no base64") from None
    return array_of(value.get("dtype"), value.get("shape"), data)


def stacked(value: Any, depth: int = MOST_AXES) -> Any:
    """Lists of numbers, and of rows of them, as one array; anything else as it is."""
    if not isinstance(value, list) or not value or not depth:
        return value
    rows = [stacked(one, depth - 1) for one in value]
    if all(type(one) in (int, float) for one in rows):
        return _array(rows)
    if all(isinstance(one, np.ndarray) and one.shape == rows[0].shape for one in rows):
        return np.stack(rows)
    return value


def _array(numbers: list[Any]) -> Any:
    try:
        return np.array(numbers, np.float64)
    except OverflowError:  # an integer that no float holds
        return numbers
