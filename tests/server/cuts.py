"""A way to a server on which connections are cut, for tests of clients that go on."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Self


class CutWay:
    """Passes bytes on until a connection has carried its share, and cuts it then.

    Attributes:
        url: where it listens.
        cuts: connections that were cut.
        shares: for each next connection how many bytes it carries, up and down together; the
            last one holds for all that follow.
    """

    def __init__(self, port: int, shares: list[int]):
        self.port, self.shares, self.cuts = port, shares, 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        threading.Thread(target=self._run, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        _end(self._listening)
        self._listening.close()

    def _run(self) -> None:
        with suppress(OSError):
            while True:
                here, _ = self._listening.accept()
                there = socket.create_connection(("127.0.0.1", self.port))
                share = self.shares.pop(0) if len(self.shares) > 1 else self.shares[0]
                threading.Thread(target=self._carry, args=(here, there, share), daemon=True).start()

    def _carry(self, here: socket.socket, there: socket.socket, share: int) -> None:
        left = [share]
        with here, there:
            up = threading.Thread(target=self._pass, args=(here, there, left), daemon=True)
            up.start()
            self._pass(there, here, left)
            up.join()
        self.cuts += left[0] <= 0

    def _pass(self, source: socket.socket, sink: socket.socket, left: list[int]) -> None:
        with suppress(OSError):
            while left[0] > 0 and (piece := source.recv(4096)):
                sink.sendall(piece)
                left[0] -= len(piece)
        _end(source)
        _end(sink)


def _end(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)


@contextmanager
def cut_way(url: str, *shares: int) -> Iterator[CutWay]:
    """A way to the server at this address."""
    with CutWay(int(url.rpartition(":")[2].rstrip("/")), list(shares)) as way:
        yield way
