"""A policy behind GR00T's policy server: ZeroMQ, with msgpack and arrays as files of numpy.

A request is {endpoint, data, api_token?}; ping says whether the server is there, reset begins an
episode, get_action answers an observation by a list of two maps, the actions and notes. Errors are
{error}. The server has one policy for all: it plays one episode at a time.

The wire has no encryption, so it is spoken only to places that the operator allows.
Source: gr00t/policy/server_client.py of Isaac-GR00T N1.6.
"""

import ast
import io
from typing import Any

import numpy as np

from hide_tasks.contract import InvalidAction, Observation
from workers.remote import arrays, client
from workers.remote.actions import actions_of
from workers.remote.arrays import BadMessage
from workers.remote.client import BadServer, Client, PeerError, declared_maps, dial
from workers.remote.maps import cameras_in
from workers.remote.observations import told
from workers.remote.target import About, Target
from workers.remote.words import plain_text
from workers.remote.zmtp import Requests, ZmtpError

ARRAY = "__ndarray_class__"
LARGEST_HEADER = 1000  # bytes of an array's header
MAGIC = b"\x93NUMPY"


class Gr00tPolicy(Client):
    """A policy behind GR00T's wire; each episode has a connection of its own."""

    _requests: Requests | None = None

    def close(self) -> None:
        if self._requests:
            self._requests.close()
            self._requests = None

    def _connect(self, patience: float) -> About:
        self._observation, self._action = declared_maps(self.target.policy)
        _, raw = dial(self.target, patience)
        try:
            self._requests = Requests(raw, arrays.MAX_MESSAGE)
            self._exchanged("ping")
            raw.settimeout(None)  # the process has a limit
        except (ZmtpError, OSError, EOFError, PeerError, InvalidAction) as error:
            raw.close()
            reason = client.reason_of(error)
            raise BadServer(f"{self.target.policy.url} is no such server: {reason}") from None
        return About(dialect="gr00t", cameras=cameras_in(self._observation))

    def _begin(self, instruction: str) -> None:
        self._exchanged("reset", {"options": None})

    def _ask(self, observation: Observation) -> list[Any]:
        told_it = told(observation, self._observation)
        reply = self._exchanged("get_action", {"observation": told_it, "options": None})
        if isinstance(reply, list) and len(reply) == 2:
            reply = reply[0]
        if not isinstance(reply, dict):
            raise InvalidAction(f"the reply is {type(reply).__name__}; expected two maps")
        return actions_of(reply, self._action)

    def _exchanged(self, endpoint: str, data: dict[str, Any] | None = None) -> Any:
        if self._requests is None:
            raise PeerError("there is no connection; an episode begins with a reset")
        request: dict[str, Any] = {"endpoint": endpoint}
        request |= {"data": data} if data is not None else {}
        request |= {"api_token": self.target.key} if self.target.key else {}
        try:
            reply = unpack(self._requests.ask(pack(request)))
        except (ZmtpError, BadMessage) as error:
            raise InvalidAction(f"no reply that may be read: {error}") from None
        except (OSError, EOFError) as error:
            raise PeerError(f"the server is gone: {client.reason_of(error)}") from None
        if isinstance(reply, dict) and "error" in reply:
            raise PeerError(f"the server says: {plain_text(str(reply['error']))}")
        return reply


def pack(message: object) -> bytes:
    """A message of plain values and numeric arrays.

    Raises:
        BadMessage: it holds something else, or is too large.
    """
    return arrays.write(message, _packed)


def _packed(value: object) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        file = io.BytesIO()
        np.save(file, value, allow_pickle=False)
        return {ARRAY: True, "as_npy": file.getvalue()}
    raise arrays.no_number(value)


def unpack(data: bytes) -> Any:
    """The message in bytes.

    Raises:
        BadMessage: it is none, or holds what no message of ours may.
    """
    return arrays.read(data, _on_map)


def _on_map(value: dict[Any, Any]) -> Any:
    return _array(value.get("as_npy")) if ARRAY in value else value


def _array(data: object) -> np.ndarray[Any, Any]:
    """The array in a file of numpy's format, of plain numbers and rows one after the other."""
    if not isinstance(data, bytes) or len(data) < 10 or not data.startswith(MAGIC):
        raise BadMessage("an array that is no file of numpy's format")
    version, sized = data[6], data[8:12] if data[6] > 1 else data[8:10]
    start = 8 + len(sized)
    end = start + int.from_bytes(sized, "little")
    if version not in (1, 2) or end - start > LARGEST_HEADER:
        raise BadMessage(f"an array with a header of {end - start} bytes, version {version}")
    name, fortran, shape = _header(data[start:end])
    if fortran and len(shape) > 1:
        return arrays.array_of(name, list(shape[::-1]), data[end:]).T
    return arrays.array_of(name, list(shape), data[end:])


def _header(text: bytes) -> tuple[object, bool, tuple[Any, ...]]:
    """The type's name, whether columns come first, and the shape."""
    try:
        found = ast.literal_eval(text.decode("latin1").strip())
        name, fortran, shape = found["descr"], found["fortran_order"], found["shape"]
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError):
        raise BadMessage("an array whose header cannot be read") from None
    if not isinstance(shape, tuple) or not isinstance(fortran, bool):
        raise BadMessage("an array whose header cannot be read")
    return name, fortran, shape


def load(target: Target) -> Gr00tPolicy:
    """The policy at a target; nothing is connected yet."""
    return Gr00tPolicy(target)
