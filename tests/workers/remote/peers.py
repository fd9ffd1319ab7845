"""Policy servers as strangers might write them: what they say is up to each test."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

from websockets.sync.server import ServerConnection, serve

from workers.protocol import RemotePolicy
from workers.remote import arrays
from workers.remote.target import Target

STATE = {
    "observation/image": {"from": "front.rgb"},
    "observation/state": {"from": ["joint_positions", "gripper_opening"]},
    "prompt": {"from": "instruction"},
}
JOINTS = {"kind": "joint_position"}


def brief(value: object) -> str | None:
    """The name of bytes in a test's name; megabytes of them would stand there otherwise."""
    return f"{len(value)}_bytes" if isinstance(value, bytes) else None


def declared(url: str, **changes: Any) -> RemotePolicy:
    """A plain openpi policy of joint positions at an address."""
    content = {"url": url, "observation": STATE, "action": JOINTS, **changes}
    return RemotePolicy.model_validate(content)


def target(url: str, **changes: Any) -> Target:
    """The same, to be connected to on this machine."""
    return Target(policy=declared(url, **changes), allowed=("127.0.0.1",))


@contextlib.contextmanager
def websocket(handler: Callable[[ServerConnection], None], **settings: Any) -> Iterator[str]:
    """The address of a WebSocket server that does this with each connection."""
    with serve(handler, "127.0.0.1", 0, compression=None, **settings) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        finally:
            server.shutdown()
            thread.join()


@contextlib.contextmanager
def answering(
    answer: Callable[[dict[Any, Any]], Any], metadata: dict[str, Any] | None = None
) -> Iterator[str]:
    """A server that answers each message with what the function gives; bytes and text as they are.

    Its answers that are dictionaries are packed.
    """

    def handler(connection: ServerConnection) -> None:
        connection.send(arrays.pack(metadata or {}))
        for frame in connection:
            reply = answer(arrays.unpack(frame))
            connection.send(reply if isinstance(reply, bytes | str) else arrays.pack(reply))

    with websocket(handler, max_size=None) as url:
        yield url


@contextlib.contextmanager
def raw(handler: Callable[[socket.socket], None]) -> Iterator[str]:
    """The address of a TCP server that does this with its first connection, then closes it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def accept() -> None:
            with contextlib.suppress(OSError):
                connection, _ = listener.accept()
                with connection:
                    handler(connection)

        thread = threading.Thread(target=accept)
        thread.start()
        try:
            yield f"ws://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            with contextlib.suppress(OSError):  # wakes accept
                socket.create_connection(listener.getsockname(), timeout=1).close()
            thread.join()
