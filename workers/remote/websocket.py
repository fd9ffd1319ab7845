"""A WebSocket to a policy server, broken by whatever goes wrong on it."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from hide_tasks.contract import InvalidAction
from workers.remote import arrays, client, egress
from workers.remote.client import BadServer, Client, PeerError, dial
from workers.remote.target import Target
from workers.remote.words import plain_text


class Connection:
    """An open WebSocket.

    Args:
        target: where to.
        patience: seconds in which a connection that is refused is tried again.

    Raises:
        BadServer: there is no WebSocket.
        Forbidden: it may not be connected to.
    """

    def __init__(self, target: Target, patience: float):
        self._url = target.policy.url
        headers = {"Authorization": f"Api-Key {target.key}"} if target.key else None
        with ExitStack() as stack:
            peer, raw = dial(target, patience)
            stack.enter_context(raw)
            try:
                opened = connect(
                    self._url,
                    sock=raw,  # with which redirects are refused
                    ssl=egress.tls(peer),
                    server_hostname=peer.host if peer.secure else None,
                    compression=None,
                    additional_headers=headers,
                    proxy=None,
                    open_timeout=client.CONNECT_LIMIT,
                    ping_interval=None,  # servers that infer in their event loop answer none
                    close_timeout=1.0,
                    max_size=arrays.MAX_MESSAGE,
                )
                self._socket: ClientConnection = stack.enter_context(opened)
            except (WebSocketException, TimeoutError, OSError, ValueError) as error:
                raise self._bad(error) from None
            self._stack = stack.pop_all()

    def greeting(
        self, read: Callable[[bytes], dict[Any, Any]], hello: bytes | None = None
    ) -> dict[Any, Any]:
        """What the server says of itself, in answer to our words if it does not speak first.

        Raises:
            BadServer: nothing that can be read; the connection is closed.
        """
        try:
            if hello is not None:
                self._socket.send(hello)
            return read(binary(self._socket.recv(timeout=client.CONNECT_LIMIT)))
        except (WebSocketException, TimeoutError, OSError, ValueError, PeerError) as error:
            self.close()
            raise self._bad(error) from None

    def send(self, data: bytes) -> None:
        """Sends a message.

        Raises:
            PeerError, InvalidAction: the server is gone, or has sent what is no message.
        """
        try:
            self._socket.send(data)
        except ConnectionClosed as error:
            raise _broken(error) from None

    def exchange(self, data: bytes) -> str | bytes:
        """The frame that comes after a message was sent.

        Raises:
            PeerError: the server failed.
            InvalidAction: what it sent is no message.
        """
        try:
            self._socket.send(data)
            return self._socket.recv()
        except ConnectionClosed as error:
            raise _broken(error) from None

    def close(self) -> None:
        """Ends it."""
        self._stack.close()

    def _bad(self, error: Exception) -> BadServer:
        return BadServer(f"{self._url} is no such server: {_reason(error)}")


class WebSocketClient(Client):
    """A policy behind a WebSocket; each episode has a connection of its own."""

    _connection: Connection | None = None

    def close(self) -> None:
        if self._connection:
            self._connection.close()
            self._connection = None

    @property
    def _there(self) -> Connection:
        if self._connection is None:
            raise PeerError("there is no connection; an episode begins with a reset")
        return self._connection

    def _connected(self, patience: float) -> Connection:
        self._connection = Connection(self.target, patience)
        return self._connection


def _broken(error: ConnectionClosed) -> Exception:
    if error.sent and not (error.rcvd and error.rcvd_then_sent):
        return InvalidAction(f"no reply that may be read: {_reason(error)}")
    return PeerError(f"the server closed the connection: {_reason(error)}")


def _reason(error: Exception) -> str:
    if isinstance(error, InvalidStatus):
        return f"it answered with HTTP status {error.response.status_code}"
    return client.reason_of(error)


def binary(frame: str | bytes) -> bytes:
    """The frame, if it is no text, as which errors come.

    Raises:
        PeerError: it is one.
    """
    if isinstance(frame, str):
        raise PeerError(f"the server says: {plain_text(frame)}")
    return frame


def unpacked(read: Callable[[bytes], dict[Any, Any]], data: bytes) -> dict[Any, Any]:
    """The message in a frame.

    Raises:
        InvalidAction: there is none that may be read.
    """
    try:
        return read(data)
    except arrays.BadMessage as error:
        raise InvalidAction(f"no reply that may be read: {error}") from None
