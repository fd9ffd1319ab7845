"""Our own policies behind OpenVLA's `POST /act` (see `workers.remote.act`).

Nothing on this wire tells of a new episode, so every request is one of its own: a policy that
remembers has nothing to remember here.
"""

from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from workers.policies import Hosted
from workers.policy_process import PolicyProcess
from workers.remote import json_arrays
from workers.remote.act import PATH
from workers.remote.arrays import MAX_MESSAGE
from workers.remote.observations import observation_of
from workers.remote.seats import SEED, BadRequest, Seats, acted
from workers.remote.serving import BAD, is_key

STILL_LIMIT = 30.0  # s for a request to come, and for its answer to be taken


class ActServer:
    """A policy behind OpenVLA's wire; arguments as `serving.WebSocketServer`."""

    def __init__(
        self, policy: Hosted, *, sessions: int = 1, model: str = "", key: str | None = None
    ):
        self.key, self.model = key, model
        self._seats = Seats(policy, sessions)

    def listen(self, host: str, port: int) -> ThreadingHTTPServer:
        """A server that has the port; `serve_forever` then answers. Pages of browsers are refused.

        Raises:
            OSError: the port is taken.
        """
        return _Listening((host, port), partial(_Handler, self))

    def close(self) -> None:
        """Ends every process, whatever it is doing."""
        self._seats.close()

    def answer(self, body: bytes) -> tuple[int, bytes]:
        """The status and content of the answer to a request's body."""
        with self._seats.taken() as seat:
            if seat is None:
                return 503, json_arrays.pack("all sessions are taken")
            try:
                message = json_arrays.unpack(body)
                return 200, json_arrays.pack(seat.call(partial(_acted, seat.process, message)))
            except BAD as error:
                return 400, json_arrays.pack(str(error))


class _Listening(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False


def _acted(process: PolicyProcess, message: Any) -> dict[str, Any]:
    if not isinstance(message, dict):
        raise BadRequest(f"the message is {type(message).__name__}; expected a map")
    observation = observation_of(message)
    process.reset(observation.instruction, SEED)
    return acted(process, observation)


class _Handler(BaseHTTPRequestHandler):
    timeout = STILL_LIMIT
    server_version, sys_version = "hide", ""

    def __init__(self, served: ActServer, *args: Any):
        self._served = served
        super().__init__(*args)

    def do_GET(self) -> None:
        """Tells whether it is well."""
        self._send(200 if self.path == "/healthz" else 404, b'"OK"')

    def do_POST(self) -> None:
        """Answers an observation by an action."""
        if self.path != PATH:
            self._send(404, json_arrays.pack(f"there is {PATH}"))
        elif self.headers.get("Origin"):
            self._send(403, json_arrays.pack("a page of a browser"))
        elif not is_key(self.headers.get("Authorization", ""), self._served.key):
            self._send(401, json_arrays.pack("send the header Authorization: Api-Key …"))
        else:
            self._answer(self.headers.get("Content-Length", ""))

    def _answer(self, length: str) -> None:
        if not length.isascii() or not length.isdecimal() or len(length) > 10:
            self._send(411, json_arrays.pack("send Content-Length"))
        elif int(length) > MAX_MESSAGE:
            self._send(413, json_arrays.pack(f"at most {MAX_MESSAGE} bytes are read"))
        else:
            self._send(*self._served.answer(self.rfile.read(int(length))))

    def _send(self, status: int, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Says nothing: a served policy's log is its process's."""
