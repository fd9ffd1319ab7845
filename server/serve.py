"""Runs the server until it is told to stop: checks first, then the port, then the workers."""

import errno
import importlib
import socket
from collections.abc import Callable
from contextlib import suppress

import uvicorn
from fastapi import FastAPI

from server.arguments import BadUsage
from server.data_folder import DataFolderError
from server.db import LedgerError
from server.exposure import require_safe
from server.settings import Settings
from workers.sandbox.choice import NoSandbox, chosen

BACKLOG = 128
GRACE = 3  # s that open requests have when the server stops


def serve(settings: Settings, ready: Callable[[str], None] = lambda _: None) -> None:
    """Serves until SIGINT or SIGTERM.

    Args:
        ready: told the address once the server answers.

    Raises:
        BadUsage: the address, the sandbox or the data folder cannot be used; nothing was touched.
    """
    try:
        sandbox = chosen(settings.sandbox)
    except NoSandbox as error:
        raise BadUsage(str(error)) from None
    require_safe(settings, sandbox)
    settings = settings.model_copy(update={"sandbox": sandbox.value})
    with bound(settings.host, settings.port) as listening:
        settings = settings.model_copy(update={"port": listening.getsockname()[1]})
        app = _application(settings)
        server = _Server(
            uvicorn.Config(
                app,
                log_level="warning",
                log_config=None,
                timeout_graceful_shutdown=GRACE,
                server_header=False,
                proxy_headers=settings.public_url is not None,  # else anybody names any address
            ),
            lambda: ready(app.state.hub.entrance),
        )
        with suppress(KeyboardInterrupt):  # uvicorn repeats it once everything is shut down
            server.run(sockets=[listening])


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]):
        super().__init__(config)
        self.ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self.ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self.config.app.state.hub.bell.close()  # type: ignore[union-attr]
        await super().shutdown(sockets)


def bound(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        BadUsage: the address cannot be used.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Only of sockets that are said to be TCP's does asyncio turn Nagle's algorithm off, which
    # would hold back every answer's body for 40 ms.
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(BACKLOG)  # a server that only binds would be let beside this one
    except OSError as error:
        listening.close()
        why = (
            "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used: {error.strerror}"
        )
        raise BadUsage(f"Port {port} of {host} {why}; give another --port.") from None
    listening.set_inheritable(False)
    return listening


def _application(settings: Settings) -> FastAPI:
    """The API with its pages; they stand above the server and are loaded by name."""
    try:
        app: FastAPI = importlib.import_module("web.app").create_app(settings)
    except (DataFolderError, LedgerError) as error:
        raise BadUsage(str(error)) from None
    return app
