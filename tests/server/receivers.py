"""Receivers of webhooks, for tests: real ones, which verify what they get, and hostile ones."""

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from standardwebhooks import Webhook as Verifier


class Receiver:
    """Answers deliveries, and keeps those whose signature is right.

    Attributes:
        statuses: what the next deliveries are answered with; 204 when they are used up.
        taken: id, body of every delivery that was answered with 2xx.
        tried: ids of all, in order.
        secret: what they are signed with.
    """

    def __init__(self, statuses: list[int]):
        self.statuses, self.secret = statuses, ""
        self.taken: list[tuple[str, dict[str, Any]]] = []
        self.tried: list[str] = []
        self.hold = threading.Event()
        self.hold.set()
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                receiver.hold.wait(30)
                body = self.rfile.read(int(self.headers["content-length"]))
                status = receiver.answer(body, dict(self.headers.items()))
                self.send_response(status)
                self.send_header("Location", "/elsewhere")
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_: object) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook?a=b"

    def answer(self, body: bytes, headers: dict[str, str]) -> int:
        """What a delivery is answered with.

        Raises:
            WebhookVerificationError: the signature is wrong.
        """
        Verifier(self.secret).verify(body, headers)
        id = {name.lower(): value for name, value in headers.items()}["webhook-id"]
        status = self.statuses.pop(0) if self.statuses else 204
        self.tried.append(id)
        if status < 300:
            self.taken.append((id, json.loads(body)))
        return status

    def kinds(self) -> list[str]:
        """What it was told of, in order."""
        return [body["type"] for _, body in self.taken]


@contextmanager
def receiver(*statuses: int) -> Iterator[Receiver]:
    """A receiver on this machine."""
    found = Receiver(list(statuses))
    thread = threading.Thread(target=found.server.serve_forever, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        found.hold.set()
        found.server.shutdown()
        found.server.server_close()


@contextmanager
def dripping(answer: Callable[[int], bytes]) -> Iterator[str]:
    """The address of a server that answers byte by byte, for ever."""

    stop = threading.Event()
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with suppress(OSError):
            while not stop.is_set():
                connection, _ = listening.accept()
                with suppress(OSError), connection:
                    connection.recv(65536)
                    for number in range(10_000):
                        if stop.is_set():
                            break
                        connection.sendall(answer(number))
                        time.sleep(0.05)

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
    finally:
        stop.set()
        with suppress(OSError):
            listening.shutdown(socket.SHUT_RDWR)
        listening.close()
