"""The headers that keep a page's power small: a content security policy a page, no sniffing.

Only the page of an episode runs WebAssembly, and only there the viewer writes inline styles.
"""

import re

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

WITH_VIEWER = re.compile(r"/episodes/[^/]+|/viewer/.+")


def policy(*, viewer: bool) -> str:
    """The content security policy of a page with the viewer, or of any other."""
    wasm, inline = (" 'wasm-unsafe-eval'", " 'unsafe-inline'") if viewer else ("", "")
    rules = {
        "default-src": "'none'",
        "script-src": f"'self'{wasm}",
        "style-src": f"'self'{inline}",
        "img-src": "'self' data:",
        "connect-src": "'self'",  # the viewer would ask for its latest release
        "font-src": "'self'",
        "manifest-src": "'self'",
        "base-uri": "'none'",
        "form-action": "'self'",
        "frame-ancestors": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Frame-Options": "DENY",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
STRICT, VIEWER = policy(viewer=False), policy(viewer=True)


class SecurityHeaders:
    """Adds the headers to every response, also to one that streams for hours."""

    def __init__(self, app: ASGIApp):
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        path: str = scope["path"]

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                policy = VIEWER if WITH_VIEWER.fullmatch(path) else STRICT
                headers.setdefault("Content-Security-Policy", policy)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, receive, guarded)
