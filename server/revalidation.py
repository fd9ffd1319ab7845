"""Answers that a client has already: ETag and If-None-Match (RFC 9110, 13.1.2).

What is costly to compute is asked first whether it would be the same; every other JSON document
has the hash of its bytes. Either way nobody else's cache may keep it.
"""

import hashlib
from typing import Annotated

from fastapi import Depends, FastAPI, Header, Request
from starlette.responses import Response

from hide_tasks.machine import installed

REVALIDATED = {"Cache-Control": "private, no-cache"}
FOR_EVER = {"Cache-Control": "private, max-age=31536000, immutable"}
_VERSION = installed("hide-seek") or "0"  # another version may say the same thing otherwise


class NotModified(Exception):
    """The client has what it asks for."""

    def __init__(self, tag: str):
        super().__init__(tag)
        self.tag = tag


class Revalidation:
    """Of one request."""

    def __init__(self, response: Response, shown: str | None):
        self._response, self._shown = response, shown

    def unless(self, *parts: object) -> str:
        """The ETag of an answer that follows from these parts alone.

        Raises:
            NotModified: the client has it.
        """
        tag = _tag("\n".join(map(str, (_VERSION, *parts))).encode())
        self._response.headers.update(REVALIDATED | {"ETag": tag})
        if _has(self._shown, tag):
            raise NotModified(tag)
        return tag


def _revalidation(
    response: Response,
    if_none_match: Annotated[
        str | None, Header(max_length=1000, description="ETags that the client has: 304 then.")
    ] = None,
) -> Revalidation:
    return Revalidation(response, if_none_match)


Revalidate = Annotated[Revalidation, Depends(_revalidation)]


def revalidated(request: Request, response: Response) -> Response:
    """The answer with an ETag, or 304 in its place."""
    body = getattr(response, "body", None)
    tells = request.method == "GET" and response.status_code == 200 and body
    if not tells or response.media_type != "application/json" or "etag" in response.headers:
        return response
    tag = _tag(bytes(response.body))
    if _has(request.headers.get("if-none-match"), tag):
        return _not_modified(tag)
    response.headers["ETag"] = tag
    for name, value in REVALIDATED.items():
        response.headers.setdefault(name, value)
    return response


def install(app: FastAPI) -> None:
    """Answers what a client has already."""

    async def answer(_: Request, error: Exception) -> Response:
        assert isinstance(error, NotModified)
        return _not_modified(error.tag)

    app.add_exception_handler(NotModified, answer)


def _not_modified(tag: str) -> Response:
    return Response(status_code=304, headers=REVALIDATED | {"ETag": tag})


def _tag(content: bytes) -> str:
    return f'"{hashlib.sha256(content).hexdigest()[:32]}"'


def _has(shown: str | None, tag: str) -> bool:
    """True if one of the ETags of If-None-Match is this one; weak ones compare alike."""
    if shown is None:
        return False
    names = [one.strip().removeprefix("W/") for one in shown.split(",")]
    return "*" in names or tag in names
