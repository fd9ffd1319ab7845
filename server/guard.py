"""What every request passes: the right host, no other site's page behind it, a sane size.

A server on loopback without log-in is still reached by every page that the user's browser has
open; these rules keep them out.
"""

import re
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import Problem, response

SAFE = ("GET", "HEAD", "OPTIONS")
MOST = 32 * 2**20  # bytes of a body; what is streamed has limits of its own
STREAMED = re.compile(r".*/recording|.*/policies/checkpoints|.*/uploads/[^/]+")


class Guard:
    """ASGI middleware.

    Args:
        hosts: names under which the server may be addressed, without ports.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str]):
        self.app = app
        self.hosts = frozenset(hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        if problem := self._problem(scope):
            await response(problem)(scope, receive, send)
            return
        if scope["method"] == "HEAD":  # routes know GET alone; the body is left out further below
            scope = {**scope, "method": "GET"}
        limited = receive if STREAMED.fullmatch(scope["path"]) else _limited(receive)
        await self.app(scope, limited, send)

    def _problem(self, scope: Scope) -> Problem | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(host) not in self.hosts:
            named = ", ".join(sorted(self.hosts))
            return Problem(421, "wrong_host", f"This server is {named}, not {host[:100]}.")
        if scope["method"] in SAFE:
            return None
        origin = headers.get("origin")
        elsewhere = origin is not None and origin.partition("://")[2] != host
        if elsewhere or headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return Problem(403, "cross_site", "Changes are not taken from other sites' pages.")
        return None


def _name(host: str) -> str:
    """The name in a Host header, without its port; empty if there is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _limited(receive: Receive) -> Receive:
    seen = 0

    async def counted() -> Message:
        nonlocal seen
        message = await receive()
        seen += len(message.get("body", b""))
        if seen > MOST:
            raise HTTPException(413, f"A body has at most {MOST} bytes.")
        return message

    return counted
