"""A policy behind openpi's WebSocket: one connection an episode, one message under way.

The server speaks first, in a map of what it is. What its map holds says which dialect it speaks:

hide       `hide`: a `maps.Declaration`. Before an episode {endpoint: reset, session_id,
           instruction} is answered by {ok: true}; then {endpoint: infer, session_id, request_id,
           is_first, …the observation} by {request_id, action, belief?, stop?}.
roboarena  `needs_session_id`: reset and infer have `endpoint` and `session_id`; a reset is answered
           by a text.
openpi     anything else: the observation alone. Nothing tells it of a new episode but the new
           connection, and episodes come one at a time.

Nothing else is sent: no seed, no index, no number of a step. A text frame is the server's error.
Source: openpi-client 0.1.2; RoboArena's policy server.
"""

import secrets
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from hide_tasks.contract import InvalidAction, Observation
from workers.protocol import RemotePolicy
from workers.remote import arrays
from workers.remote.actions import actions_of
from workers.remote.client import BadServer, PeerError
from workers.remote.maps import ActionMap, Declaration, ObservationMap, cameras_in
from workers.remote.observations import told
from workers.remote.target import About, Target
from workers.remote.websocket import WebSocketClient, binary, unpacked
from workers.remote.wires import Dialect
from workers.remote.words import plain_text


class Agreement(BaseModel):
    """What both sides hold to."""

    model_config = ConfigDict(frozen=True)

    about: About
    observation: ObservationMap
    action: ActionMap


class OpenpiPolicy(WebSocketClient):
    """A policy behind openpi's wire, in whichever dialect its server speaks."""

    _session = ""
    _first = True  # no observation of the episode was sent yet

    def _connect(self, patience: float) -> About:
        metadata = self._connected(patience).greeting(arrays.unpack)
        self._agreed = agree(self.target.policy, metadata)
        return self._agreed.about

    def _begin(self, instruction: str) -> None:
        self._session, self._first = secrets.token_hex(16), True
        dialect = self._agreed.about.dialect
        if dialect == "openpi":
            return
        message = {"endpoint": "reset", "session_id": self._session}
        if dialect == "hide":
            message["instruction"] = instruction
        _require_begun(self._there.exchange(arrays.pack(message)))

    def _ask(self, observation: Observation) -> list[Any]:
        agreed, request = self._agreed, secrets.token_hex(16)
        dialect = agreed.about.dialect
        message = told(observation, agreed.observation)
        if dialect != "openpi":
            message |= {"endpoint": "infer", "session_id": self._session}
        if dialect == "hide":
            message |= {"request_id": request, "is_first": self._first}
        reply = unpacked(arrays.unpack, binary(self._there.exchange(arrays.pack(message))))
        self._first = False
        actions = actions_of(reply, agreed.action)
        if dialect == "hide":
            _require_answers(reply, request)
            self._belief = reply.get("belief")
            if reply.get("stop") is True and isinstance(actions[-1], dict):
                actions[-1] = {**actions[-1], "stop": True}
        return actions


def _require_begun(reply: str | bytes) -> None:
    """Does nothing if a reset was carried out; RoboArena answers in words."""
    if isinstance(reply, str):
        if "success" not in reply.lower():
            raise PeerError(f"reset was answered: {plain_text(reply)}")
    elif not unpacked(arrays.unpack, reply).get("ok", True):
        raise PeerError("reset was answered: not ok")


def _require_answers(reply: Mapping[Any, Any], request: str) -> None:
    if reply.get("request_id") != request:
        raise InvalidAction("the reply is to another request: its request_id is not the one sent")


def agree(policy: RemotePolicy, metadata: Mapping[Any, Any]) -> Agreement:
    """What both sides hold to, from what was registered and what the server says.

    Raises:
        BadServer: they do not fit together.
    """
    dialect = _dialect(metadata)
    if policy.dialect not in (None, dialect):
        raise BadServer(f"{policy.url} speaks {dialect}, not {policy.dialect} as was registered")
    if dialect == "hide":
        return _as_declared(policy, metadata["hide"])
    if policy.observation is None or policy.action is None:
        raise BadServer(
            f"{policy.url} speaks plain {dialect}, which does not say what it wants to see; "
            "declare `observation` and `action`"
        )
    about = About(dialect=dialect, cameras=cameras_in(policy.observation))
    return Agreement(about=about, observation=policy.observation, action=policy.action)


def _dialect(metadata: Mapping[Any, Any]) -> Dialect:
    if "hide" in metadata:
        return "hide"
    return "roboarena" if "needs_session_id" in metadata else "openpi"


def _as_declared(policy: RemotePolicy, found: object) -> Agreement:
    try:
        declared = Declaration.model_validate(found)
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(map(str, ("hide", *fault["loc"])))
        message = plain_text(f"{place}: {fault['msg']}")
        raise BadServer(f"{policy.url} declares what is not understood: {message}") from None
    ours = (policy.observation, policy.action)
    if ours != (None, None) and ours != (declared.observation, declared.action):
        raise BadServer(f"{policy.url} declares other maps than were registered; leave yours out")
    about = About(
        dialect="hide",
        model=declared.model,
        sessions=declared.max_sessions if declared.stateful else 1,
        sees=tuple(declared.observation),
        cameras=cameras_in(declared.observation),
        acts=declared.action.kind,
    )
    return Agreement(about=about, observation=declared.observation, action=declared.action)


def load(target: Target) -> OpenpiPolicy:
    """The policy at a target; nothing is connected yet."""
    return OpenpiPolicy(target)
