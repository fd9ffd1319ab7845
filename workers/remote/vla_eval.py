"""A policy behind the WebSocket of vla-evaluation-harness, whose model servers wrap many others.

Every message is a map of type, payload, seq and timestamp in msgpack; arrays are maps of str keys.
The client says hello first. An episode begins with episode_start, which is not answered; then an
observation is answered by an action, or by an error that leaves the connection open. A connection
is an episode, and its end the episode's: no result is told.

`seq` is what an answer repeats, so ours is random, and tells no step; `timestamp`, which servers
want and do not read, is always 0.
Source: vla-eval 0.8.0, protocol 1.
"""

import secrets
from collections.abc import Mapping
from typing import Any

import numpy as np

from hide_tasks.contract import InvalidAction, Observation
from workers.remote import arrays
from workers.remote.actions import actions_of
from workers.remote.arrays import BadMessage
from workers.remote.client import BadServer, PeerError, declared_maps
from workers.remote.maps import ActionMap, cameras_in
from workers.remote.observations import told
from workers.remote.target import About, Target
from workers.remote.websocket import WebSocketClient, binary, unpacked
from workers.remote.words import plain_text

PROTOCOL = 1
ARRAY, IMAGE = "__ndarray__", "__image__"
LONGEST_NAME = 100  # characters of a model's name that are kept


class VlaEvalPolicy(WebSocketClient):
    """A policy behind a model server of vla-evaluation-harness."""

    def _connect(self, patience: float) -> About:
        policy = self.target.policy
        self._observation, self._action = declared_maps(policy)
        hello = pack("hello", {"harness_version": "", "protocol_version": PROTOCOL})[1]
        said = self._connected(patience).greeting(unpack, hello)
        payload = _hello(said, policy.url)
        _require_columns(payload, self._action, policy.url)
        model = plain_text(str(payload.get("model_server", "")))[:LONGEST_NAME]
        return About(
            dialect="vla_eval",
            model=model,
            sessions=policy.concurrency or 1,
            cameras=cameras_in(self._observation),
        )

    def _begin(self, instruction: str) -> None:
        self._there.send(pack("episode_start", {"task": {"name": instruction}})[1])

    def _ask(self, observation: Observation) -> list[Any]:
        seq, data = pack("observation", told(observation, self._observation))
        reply = unpacked(unpack, binary(self._there.exchange(data)))
        payload = reply["payload"]
        if reply["type"] == "error":
            raise PeerError(f"the server says: {plain_text(str(payload.get('error', payload)))}")
        if reply["type"] != "action":
            raise InvalidAction(f"the reply is {plain_text(repr(reply['type']))}, no action")
        if reply.get("seq") != seq:
            raise InvalidAction("the reply is to another request: its seq is not the one sent")
        return actions_of(payload, self._action)


def _hello(said: Mapping[Any, Any], url: str) -> Mapping[Any, Any]:
    payload: Mapping[Any, Any] = said["payload"]
    if said["type"] != "hello":
        raise BadServer(f"{url} answers hello with {plain_text(repr(said['type']))}")
    if payload.get("protocol_version", PROTOCOL) != PROTOCOL:
        version = plain_text(repr(payload["protocol_version"]))
        raise BadServer(f"{url} speaks protocol {version} of vla-eval; expected {PROTOCOL}")
    return payload


def _require_columns(payload: Mapping[Any, Any], action: ActionMap, url: str) -> None:
    """Does nothing unless a server says that its actions have another number of columns."""
    spec = payload.get("action_spec")
    parts = list(spec.values()) if isinstance(spec, dict) else []
    found = [part.get("dims") if isinstance(part, dict) else None for part in parts]
    dims = [one for one in found if isinstance(one, int) and one > 0]
    if not dims or len(dims) < len(found) or action.kind == "action":
        return  # it does not say
    if sum(dims) != action.columns:
        raise BadServer(
            f"{url} says that its actions have {sum(dims)} columns; {action.kind} was declared, "
            f"which has {action.columns}"
        )


def pack(kind: str, payload: Mapping[str, Any]) -> tuple[int, bytes]:
    """A message of that type, and what its answer repeats.

    Raises:
        BadMessage: it cannot be sent.
    """
    seq = secrets.randbits(53)  # what a double can hold
    return seq, packed(kind, payload, seq)


def packed(kind: str, payload: Mapping[str, Any], seq: int) -> bytes:
    """A message of that type and number.

    Raises:
        BadMessage: it cannot be sent.
    """
    message = {"type": kind, "payload": payload, "seq": seq, "timestamp": 0.0}
    return arrays.write(message, _packed)


def _packed(value: object) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        shape, dtype = list(value.shape), value.dtype.str
        return {ARRAY: True, "data": value.tobytes(), "dtype": dtype, "shape": shape}
    raise arrays.no_number(value)


def unpack(data: bytes) -> dict[Any, Any]:
    """The message in bytes: a map that has a type and a payload, which is a map.

    Raises:
        BadMessage: it is none.
    """
    message = arrays.as_map(arrays.read(data, _on_map))
    if not isinstance(message.get("type"), str) or not isinstance(message.get("payload"), dict):
        raise BadMessage("the message has no type or no payload")
    return message


def _on_map(value: dict[Any, Any]) -> Any:
    if IMAGE in value:
        raise BadMessage("an encoded image; only plain numbers are read")
    if ARRAY in value:
        return arrays.array_of(value.get("dtype"), value.get("shape"), value.get("data"))
    return value


def load(target: Target) -> VlaEvalPolicy:
    """The policy at a target; nothing is connected yet."""
    return VlaEvalPolicy(target)
