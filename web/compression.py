"""Answers are compressed where that saves something and gives nothing away."""

from starlette.datastructures import Headers
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from server.blobs import CHECKPOINT, RRD

LEVEL = 4  # of 9: 1.2 MB of a large leaderboard take 10 ms instead of 25
LEAST = 1000  # bytes
OWN = ("application/wasm", "application/octet-stream", RRD, CHECKPOINT)  # packed, or not text
COMPACT = (*DEFAULT_EXCLUDED_CONTENT_TYPES, *OWN)


class Compression:
    """Compresses text for whoever takes gzip and shows no cookie.

    The page of somebody who signed in holds what its forms must show, beside what its address says;
    compressed together, its length would tell the one by trying the other (BREACH).
    """

    def __init__(self, app: ASGIApp):
        self.app = app
        self.compressed = GZipMiddleware(app, LEAST, LEVEL, exclude_content_types=COMPACT)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        secret = scope["type"] == "http" and "cookie" in Headers(scope=scope)
        await (self.app if secret else self.compressed)(scope, receive, send)
