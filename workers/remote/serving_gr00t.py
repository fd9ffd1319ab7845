"""Our own policies behind GR00T's ZeroMQ (see `workers.remote.gr00t`), by libzmq's own socket.

One policy for everybody, as GR00T's server has it: one episode at a time, begun by `reset`, whose
instruction comes with the first observation. The wire has no encryption.
"""

import hmac
from collections.abc import Mapping
from functools import partial
from types import TracebackType
from typing import Any, Self

from workers.policies import Hosted
from workers.policy_process import PolicyProcess
from workers.remote import gr00t
from workers.remote.arrays import MAX_MESSAGE
from workers.remote.observations import observation_of
from workers.remote.seats import SEED, BadRequest, Seat, Seats, acted
from workers.remote.serving import BAD

LOOK_EVERY = 200  # ms between two looks whether it is to end


class Gr00tServer:
    """A policy behind GR00T's wire; arguments as `serving.WebSocketServer`, for one session."""

    def __init__(
        self, policy: Hosted, *, sessions: int = 1, model: str = "", key: str | None = None
    ):
        if sessions != 1:
            raise ValueError("GR00T's wire tells no sessions apart; there can be one")
        self.key, self.model = key, model
        self._seats = Seats(policy, sessions)

    def listen(self, host: str, port: int) -> "Listening":
        """A server that has the port; `serve_forever` then answers.

        Raises:
            OSError: the port is taken.
            ImportError: libzmq is not installed.
        """
        return Listening(self, host, port)

    def close(self) -> None:
        """Ends the process, whatever it is doing."""
        self._seats.close()

    def seat(self) -> Any:
        """The only place."""
        return self._seats.taken()


class Listening:
    """A REP socket and its loop."""

    def __init__(self, served: Gr00tServer, host: str, port: int):
        import zmq

        self._served, self._ended = served, False
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.set(zmq.LINGER, 0)
        self._socket.set(zmq.MAXMSGSIZE, MAX_MESSAGE)
        self._socket.set(zmq.IPV6, ":" in host)
        try:
            self._socket.bind(f"tcp://{f'[{host}]' if ':' in host else host}:{port or '*'}")
        except zmq.ZMQError as error:
            self._context.destroy()
            raise OSError(error.errno, error.strerror) from None
        self.port = int(self._socket.get_string(zmq.LAST_ENDPOINT).rpartition(":")[2])

    def serve_forever(self) -> None:
        """Answers until `shutdown`."""
        with self._served.seat() as seat:
            session = _Session(seat, self._served.key)
            while not self._ended:
                if self._socket.poll(LOOK_EVERY):
                    parts = self._socket.recv_multipart()
                    self._socket.send(session.answer(b"".join(parts)))

    def shutdown(self) -> None:
        """Ends the loop; from any thread."""
        self._ended = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.destroy()


class _Session:
    """Everybody's episodes."""

    def __init__(self, seat: Seat, key: str | None):
        self._seat, self._key = seat, key
        self._fresh = True

    def answer(self, frame: bytes) -> bytes:
        try:
            return gr00t.pack(self._seat.call(partial(self._answer, gr00t.unpack(frame))))
        except BAD as error:
            return gr00t.pack({"error": str(error)})

    def _answer(self, message: Any) -> Any:
        if not isinstance(message, dict):
            raise BadRequest(f"the message is {type(message).__name__}; expected a map")
        shown = str(message.get("api_token", "")).encode(errors="surrogatepass")
        if self._key and not hmac.compare_digest(shown, self._key.encode()):
            raise BadRequest("api_token is not the right one")
        data = message.get("data")
        return self._of(message.get("endpoint"), data if isinstance(data, dict) else {})

    def _of(self, endpoint: object, data: Mapping[Any, Any]) -> Any:
        if endpoint == "ping":
            return {"status": "ok", "message": "Server is running"}
        if endpoint == "reset":
            self._fresh = True
            return {}
        if endpoint == "get_action":
            seen = data.get("observation")
            return [self._act(self._seat.process, seen if isinstance(seen, dict) else {}), {}]
        raise BadRequest(f"no endpoint '{str(endpoint)[:40]}'; there are ping, reset, get_action")

    def _act(self, process: PolicyProcess, message: Mapping[Any, Any]) -> dict[str, Any]:
        observation = observation_of(message)
        if self._fresh:
            process.reset(observation.instruction, SEED)
            self._fresh = False
        return acted(process, observation)
