"""Our own policies behind openpi's WebSocket, in the dialect `hide` (see `workers.remote.openpi`).

Each session has a policy process to itself, so nothing leaks from one episode into another. A
client that knows no dialect sends observations alone; its connection is its episode.
"""

import hmac
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from time import monotonic
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

SEAT_LIMIT = 2.0  # s for a session that is just ending to make room
LOOK_EVERY = 0.2  # s between two looks whether a client is still there
IDLE_LIMIT = 900.0  # s without a message, after which a session is over
SEED = 0  # of every session: nothing that tells episodes apart crosses the wire
LONGEST_ID = 100
TRY_AGAIN, FAILED = 1013, 1011  # codes of RFC 6455's registry


class BadRequest(ValueError):
    """A message that a client should not have sent."""


class Seat:
    """A policy process and the thread that starts it: on Linux it ends with that thread."""

    def __init__(self, process: PolicyProcess):
        self.process = process
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="policy")

    def call(self, function: Callable[[], Any], wanted: Callable[[], bool] = lambda: True) -> Any:
        """What the function returns, called in the process's thread.

        Args:
            wanted: asked again and again; the process is killed when nobody wants its answer.
        """
        asked = self._thread.submit(function)
        while not wait([asked], timeout=LOOK_EVERY).done:
            if not wanted():
                self.process.kill()
        return asked.result()

    def close(self) -> None:
        """Ends the process, and so whatever is asked of it."""
        self.process.kill()
        self._thread.submit(self.process.close)
        self._thread.shutdown()


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
            return self._reset(_text(message, "session_id"), _text(message, INSTRUCTION))
        if endpoint not in (None, "infer"):
            raise BadRequest(f"no endpoint '{str(endpoint)[:40]}'; there are reset and infer")
        if endpoint is None and self.name is None:
            self._reset("", _text(message, INSTRUCTION))
        if self.name is None or message.get("session_id", "") != self.name:
            raise BadRequest("this session did not begin here; send endpoint reset first")
        return self._infer(message)

    def _reset(self, name: str, instruction: str) -> dict[str, Any]:
        self.process.reset(instruction, SEED)
        self.name = name
        return {"ok": True}

    def _infer(self, message: Mapping[Any, Any]) -> dict[str, Any]:
        began = monotonic()
        action = self.process.act(observation_of(message))
        belief = self.process.belief()
        reply = {"action": action, "server_timing": {"infer_ms": 1e3 * (monotonic() - began)}}
        if belief is not None:
            reply["belief"] = belief.model_dump(mode="json")
        if "request_id" in message:
            reply["request_id"] = _text(message, "request_id", LONGEST_ID)
        return reply


def _text(message: Mapping[Any, Any], name: str, longest: int = 10_000) -> str:
    value = message.get(name)
    if not isinstance(value, str) or len(value) > longest:
        found = "missing" if value is None else type(value).__name__
        raise BadRequest(f"{name} is {found}; expected a text of at most {longest} characters")
    return value


class PolicyServer:
    """A policy, ready for so many episodes at a time.

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
        self.key = key
        declared = Declaration(model=model, observation=everything(), max_sessions=sessions)
        self._greeting = arrays.pack(declared.message())
        self._free: SimpleQueue[Seat] = SimpleQueue()
        self._seats = [Seat(policy.make()) for _ in range(sessions)]
        for seat in self._seats:
            try:
                seat.call(seat.process.load)
            except BaseException:
                self.close()
                raise
            self._free.put(seat)

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
        for seat in self._seats:
            seat.close()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        if request.path == "/healthz":
            return connection.respond(200, "OK\n")
        given = request.headers.get("Authorization", "")
        if self.key and not hmac.compare_digest(_bytes(given), _bytes(f"Api-Key {self.key}")):
            return connection.respond(401, "Send the header Authorization: Api-Key …\n")
        return None

    def _handle(self, connection: ServerConnection) -> None:
        with self._seated() as seat, suppress(ConnectionClosed):
            if seat is None:
                connection.close(TRY_AGAIN, "all sessions are taken")
                return
            connection.send(self._greeting)
            _converse(connection, seat)

    @contextmanager
    def _seated(self) -> Iterator[Seat | None]:
        try:
            seat = self._free.get(timeout=SEAT_LIMIT)
        except Empty:
            yield None
            return
        try:
            yield seat
        finally:
            self._free.put(seat)


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


def _converse(connection: ServerConnection, seat: Seat) -> None:
    """Answers until the client is gone, idle or wrong; what is wrong is told as openpi does."""
    session = Session(seat.process)
    try:
        while True:
            frame = connection.recv(timeout=IDLE_LIMIT)
            if isinstance(frame, str):
                raise BadRequest("a text; expected a binary frame")
            answer = partial(session.answer, arrays.unpack(frame))
            reply = seat.call(answer, wanted=lambda: connection.protocol.state is State.OPEN)
            connection.send(arrays.pack(reply))
    except TimeoutError:
        connection.close(TRY_AGAIN, "idle")
    except (BadRequest, BadObservation, arrays.BadMessage, PolicyFailure) as error:
        connection.send(str(error))
        connection.close(FAILED, "failed")
