"""Our own policies behind openpi's WebSocket, in the dialect `hide` (see `workers.remote.openpi`).

Each session has a policy process to itself, so nothing leaks from one episode into another. A
client that knows no dialect sends observations alone; its connection is its episode.
"""

import hmac
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.protocol import State
from websockets.sync.server import Server, ServerConnection, serve

from hide_tasks.contract import PolicyFailure
from workers.policies import Hosted
from workers.policy_process import PolicyProcess
from workers.remote import arrays
from workers.remote.maps import INSTRUCTION, Declaration, everything
from workers.remote.observations import BadObservation, observation_of
from workers.remote.seats import SEED, BadRequest, Seat, Seats, acted, text_of

IDLE_LIMIT = 900.0  # s without a message, after which a session is over
LONGEST_ID = 100
TRY_AGAIN, FAILED = 1013, 1011  # codes of RFC 6455's registry
BAD = (BadRequest, BadObservation, arrays.BadMessage, PolicyFailure)


@dataclass
class Session:
    """The episodes of one connection."""

    process: PolicyProcess
    name: str | None = None  # as the client named it; None: no episode began

    def answer(self, message: Mapping[Any, Any]) -> dict[str, Any]:
        """The reply to a message.

        Raises:
            BadRequest, BadObservation: the message is none of ours.
            PolicyFailure: the policy failed.
        """
        endpoint = message.get("endpoint")
        if endpoint == "reset":
            return self._reset(text_of(message, "session_id"), text_of(message, INSTRUCTION))
        if endpoint not in (None, "infer"):
            raise BadRequest(f"no endpoint '{str(endpoint)[:40]}'; there are reset and infer")
        if endpoint is None and self.name is None:
            self._reset("", text_of(message, INSTRUCTION))
        if self.name is None or message.get("session_id", "") != self.name:
            raise BadRequest("this session did not begin here; send endpoint reset first")
        return self._infer(message)

    def _reset(self, name: str, instruction: str) -> dict[str, Any]:
        self.process.reset(instruction, SEED)
        self.name = name
        return {"ok": True}

    def _infer(self, message: Mapping[Any, Any]) -> dict[str, Any]:
        reply = acted(self.process, observation_of(message))
        if "request_id" in message:
            reply["request_id"] = text_of(message, "request_id", LONGEST_ID)
        return reply


class WebSocketServer(ABC):
    """A policy behind a WebSocket; what is said on it is the subclasses' affair.

    Args:
        policy: what is served; a process of it is started for each session.
        sessions: how many there are at a time.
        model: what clients are told that it is.
        key: what they must send; None lets everybody in.

    Raises:
        PolicyFailure: it cannot be loaded.
    """

    def __init__(
        self, policy: Hosted, *, sessions: int = 1, model: str = "", key: str | None = None
    ):
        self.key, self.model, self.sessions = key, model, sessions
        self.cameras = policy.cameras
        self._seats = Seats(policy, sessions)

    def listen(self, host: str, port: int) -> Server:
        """A server that has the port; `serve_forever` then answers. Pages of browsers are refused.

        Raises:
            OSError: the port is taken.
        """
        return serve(
            self._handle,
            host,
            port,
            origins=[None],
            compression=None,
            max_size=arrays.MAX_MESSAGE,
            process_request=self._admit,
            server_header=None,
        )

    def close(self) -> None:
        """Ends every process, whatever it is doing."""
        self._seats.close()

    @abstractmethod
    def converse(self, connection: ServerConnection, seat: Seat) -> None:
        """Answers until the client is gone.

        Raises:
            TimeoutError: nothing came for long.
        """

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        if request.path == "/healthz":
            return connection.respond(200, "OK\n")
        if not is_key(request.headers.get("Authorization", ""), self.key):
            return connection.respond(401, "Send the header Authorization: Api-Key …\n")
        return None

    def _handle(self, connection: ServerConnection) -> None:
        with self._seats.taken() as seat, suppress(ConnectionClosed):
            if seat is None:
                connection.close(TRY_AGAIN, "all sessions are taken")
                return
            try:
                self.converse(connection, seat)
            except TimeoutError:
                connection.close(TRY_AGAIN, "idle")


class PolicyServer(WebSocketServer):
    """A policy behind openpi's wire; what is wrong is told as openpi does, and ends the session."""

    def converse(self, connection: ServerConnection, seat: Seat) -> None:
        declared = Declaration(
            model=self.model, observation=everything(self.cameras), max_sessions=self.sessions
        )
        connection.send(arrays.pack(declared.message()))
        session = Session(seat.process)
        try:
            while True:
                message = arrays.unpack(binary(connection.recv(timeout=IDLE_LIMIT)))
                reply = seat.call(partial(session.answer, message), wanted=still(connection))
                connection.send(arrays.pack(reply))
        except BAD as error:
            connection.send(str(error))
            connection.close(FAILED, "failed")


def is_key(shown: str, key: str | None) -> bool:
    """True if an Authorization header shows the key, or none is asked for."""
    return not key or hmac.compare_digest(_bytes(shown), _bytes(f"Api-Key {key}"))


def binary(frame: str | bytes) -> bytes:
    """A frame's bytes.

    Raises:
        BadRequest: it is a text.
    """
    if isinstance(frame, str):
        raise BadRequest("a text; expected a binary frame")
    return frame


def still(connection: ServerConnection) -> Callable[[], bool]:
    """True as long as somebody waits for an answer."""
    return lambda: connection.protocol.state is State.OPEN


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogateescape")
