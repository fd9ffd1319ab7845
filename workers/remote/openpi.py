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
Time limits are those of the process that this runs in, which is killed when it is late.
Source: openpi-client 0.1.2; RoboArena's policy server.
"""

import secrets
import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from hide_tasks.contract import Action, InvalidAction, Observation, parse_action
from workers.policy_host import plain
from workers.protocol import Dialect, RemotePolicy
from workers.remote import arrays, egress
from workers.remote.actions import actions_of
from workers.remote.maps import ActionMap, Declaration, ObservationMap
from workers.remote.observations import told
from workers.remote.target import PATIENCE, About, Target
from workers.remote.words import plain_text

CONNECT_LIMIT = 10.0  # s for TCP, TLS and the handshake


class PeerError(Exception):
    """The server failed, or says that it did."""


class BadServer(ValueError):
    """It cannot be reached, or it is none that could be played with; says what would be right."""


class Agreement(BaseModel):
    """What both sides hold to."""

    model_config = ConfigDict(frozen=True)

    about: About
    observation: ObservationMap
    action: ActionMap


class OpenpiPolicy:
    """A policy of the contract. One instance plays many episodes, one after the other.

    Args:
        target: where it is; `open` connects.
    """

    def __init__(self, target: Target):
        self.target = target
        self._connection: Connection | None = None
        self._fresh = False  # no episode was played over the connection yet
        self._waiting: list[Any] = []  # actions that the server gave in advance
        self._forget()

    def open(self, patience: float = PATIENCE) -> About:
        """Connects anew for an episode and finds out whom it speaks to.

        Args:
            patience: seconds in which a connection that is refused is tried again.

        Raises:
            BadServer: it cannot be reached, or not be played with.
            Forbidden: it may not be connected to.
        """
        self.close()
        self._fresh = False
        self._connection = Connection(self.target, patience)
        self._agreed = agree(self.target.policy, self._connection.metadata)
        self._fresh = True
        return self._agreed.about

    def reset(self, instruction: str, policy_seed: int) -> None:
        """A new episode: forget, and tell the server if its dialect can be told.

        Raises:
            PeerError: the server failed.
            InvalidAction: it answered something else.
        """
        if not self._fresh:
            self.open()
        self._fresh = False
        self._forget()
        dialect = self._agreed.about.dialect
        if dialect == "openpi":
            return
        message = {"endpoint": "reset", "session_id": self._session}
        if dialect == "hide":
            message["instruction"] = instruction
        self._there.reset(message)

    def act(self, observation: Observation) -> Action:
        """The next action; an answer of several keyframes is several actions.

        Raises:
            PeerError: the server failed.
            InvalidAction: it answered what is none, or not what was declared.
        """
        if not self._waiting:
            self._waiting = self._ask(observation)
        return _action(self._waiting.pop(0))

    def belief(self) -> Any:
        """What the server says that it believes."""
        return self._belief

    def close(self) -> None:
        """Ends the connection."""
        if self._connection:
            self._connection.close()
            self._connection = None

    @property
    def _there(self) -> "Connection":
        if self._connection is None:
            raise PeerError("there is no connection; an episode begins with a reset")
        return self._connection

    def _forget(self) -> None:
        self._waiting = []
        self._belief: Any = None
        self._session = secrets.token_hex(16)
        self._first = True

    def _ask(self, observation: Observation) -> list[Any]:
        agreed, request = self._agreed, secrets.token_hex(16)
        dialect = agreed.about.dialect
        message = told(observation, agreed.observation)
        if dialect != "openpi":
            message |= {"endpoint": "infer", "session_id": self._session}
        if dialect == "hide":
            message |= {"request_id": request, "is_first": self._first}
        reply = self._there.ask(message)
        self._first = False
        actions = actions_of(reply, agreed.action)
        if dialect == "hide":
            _require_answers(reply, request)
            self._belief = reply.get("belief")
            if reply.get("stop") is True and isinstance(actions[-1], dict):
                actions[-1] = {**actions[-1], "stop": True}
        return actions


def _action(value: object) -> Action:
    try:
        return parse_action(plain(value))
    except InvalidAction as error:
        raise InvalidAction(plain_text(str(error))) from None


def _require_answers(reply: Mapping[Any, Any], request: str) -> None:
    if reply.get("request_id") != request:
        raise InvalidAction("the reply is to another request: its request_id is not the one sent")


class Connection:
    """A WebSocket to a server that has said what it is; broken by whatever goes wrong on it."""

    def __init__(self, target: Target, patience: float):
        policy, peer = target.policy, egress.parse_url(target.policy.url)
        headers = {"Authorization": f"Api-Key {target.key}"} if target.key else None
        with ExitStack() as stack:
            try:
                raw = stack.enter_context(_dial(peer, target.allowed, patience))
            except OSError as error:
                reason = error.strerror or str(error)
                raise BadServer(f"{policy.url} cannot be reached: {reason}") from None
            try:
                opened = connect(
                    policy.url,
                    sock=raw,  # with which redirects are refused
                    ssl=egress.tls(peer),
                    server_hostname=peer.host if peer.secure else None,
                    compression=None,
                    additional_headers=headers,
                    proxy=None,
                    open_timeout=CONNECT_LIMIT,
                    ping_interval=None,  # servers that infer in their event loop answer none
                    close_timeout=1.0,
                    max_size=arrays.MAX_MESSAGE,
                )
                self._socket: ClientConnection = stack.enter_context(opened)
                self.metadata = arrays.unpack(_binary(self._socket.recv(timeout=CONNECT_LIMIT)))
            except (WebSocketException, TimeoutError, OSError, ValueError, PeerError) as error:
                raise BadServer(f"{policy.url} is no such server: {_reason(error)}") from None
            self._stack = stack.pop_all()

    def ask(self, message: Mapping[str, Any]) -> dict[Any, Any]:
        """The reply to a message.

        Raises:
            PeerError: the server failed.
            InvalidAction: the reply is none that may be read.
        """
        return self._unpacked(_binary(self._exchanged(message)))

    def reset(self, message: Mapping[str, Any]) -> None:
        """Tells of a new episode; RoboArena answers in words."""
        reply = self._exchanged(message)
        if isinstance(reply, str):
            if "success" not in reply.lower():
                raise PeerError(f"reset was answered: {plain_text(reply)}")
        elif not self._unpacked(reply).get("ok", True):
            raise PeerError("reset was answered: not ok")

    def close(self) -> None:
        """Ends it."""
        self._stack.close()

    def _exchanged(self, message: Mapping[str, Any]) -> str | bytes:
        try:
            self._socket.send(arrays.pack(message))
            return self._socket.recv()
        except ConnectionClosed as error:
            if error.sent and not (error.rcvd and error.rcvd_then_sent):
                raise InvalidAction(f"no reply that may be read: {_reason(error)}") from None
            raise PeerError(f"the server closed the connection: {_reason(error)}") from None

    def _unpacked(self, data: bytes) -> dict[Any, Any]:
        try:
            return arrays.unpack(data)
        except arrays.BadMessage as error:
            raise InvalidAction(f"no reply that may be read: {error}") from None


def _dial(peer: egress.Peer, allowed: tuple[str, ...], patience: float) -> Any:
    """A connected socket; a server that starts anew is waited for."""
    end, pause = time.monotonic() + patience, 0.1
    while True:
        try:
            return egress.connect(peer, allowed, CONNECT_LIMIT)
        except ConnectionRefusedError:
            if time.monotonic() + pause > end:
                raise
            time.sleep(pause)
            pause *= 2


def _binary(frame: str | bytes) -> bytes:
    if isinstance(frame, str):
        raise PeerError(f"the server says: {plain_text(frame)}")
    return frame


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return f"nothing came in {CONNECT_LIMIT:g} s"
    if isinstance(error, InvalidStatus):
        return f"it answered with HTTP status {error.response.status_code}"
    return plain_text(str(error) or type(error).__name__)


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
    about = About(dialect=dialect)
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
    )
    return Agreement(about=about, observation=declared.observation, action=declared.action)


def load(text: str) -> OpenpiPolicy:
    """The policy of a `Target` as JSON; nothing is connected yet."""
    return OpenpiPolicy(Target.model_validate_json(text))
