"""Errors of the API as problem+json (RFC 9457): what was wrong, where, and what is allowed."""

import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

logger = logging.getLogger(__name__)
MEDIA_TYPE = "application/problem+json"
MOST_ERRORS = 20


class Problem(Exception):
    """A request that cannot be granted.

    Attributes:
        status: as HTTP.
        code: stable, for programs: `not_found`, `stale_attempt`, …
        detail: one sentence for people.
        errors: `{field, message}` of each field that is wrong.
        headers: that the answer has.
        members: more of the document, by name.
    """

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        errors: Sequence[Mapping[str, str]] = (),
        headers: Mapping[str, str] | None = None,
        members: Mapping[str, Any] | None = None,
    ):
        super().__init__(detail)
        self.status, self.code, self.detail = status, code, detail
        self.headers, self.members = dict(headers or {}), dict(members or {})
        self.errors = [dict(error) for error in errors]

    @property
    def title(self) -> str:
        """The status in words."""
        known = self.status in HTTPStatus._value2member_map_
        return HTTPStatus(self.status).phrase if known else self.code.replace("_", " ").title()

    @property
    def document(self) -> dict[str, Any]:
        """The problem as the API answers it."""
        members = {
            "type": "about:blank",
            "title": self.title,
            "status": self.status,
            "code": self.code,
            "detail": self.detail,
        }
        return members | ({"errors": self.errors} if self.errors else {}) | self.members


def not_found(what: str, name: str) -> Problem:
    """Nothing has this name."""
    return Problem(404, "not_found", f"No {what} '{name[:100]}'.")


def invalid(field: str, message: str) -> Problem:
    """One field is wrong; the message says what is allowed."""
    return Problem(422, "invalid", f"{field}: {message}", [{"field": field, "message": message}])


def of_validation(errors: Sequence[Mapping[str, Any]]) -> Problem:
    """What pydantic found wrong."""
    found = [{"field": _field(error["loc"]), "message": _said(error)} for error in errors]
    if errors[0]["type"] == "json_invalid":
        found = [{"field": "body", "message": f"is not JSON: {errors[0]['ctx']['error']}"}]
    first = found[0]
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    detail = f"{first['field']}: {first['message']}{more}"
    return Problem(422, "invalid", detail, found[:MOST_ERRORS])


def _said(error: Mapping[str, Any]) -> str:
    """The message, without the name of the exception that pydantic puts before our own."""
    return str(error["msg"]).removeprefix("Value error, ").removeprefix("Assertion failed, ")


def _field(location: Sequence[str | int]) -> str:
    if location[:1] == ("query",) and isinstance(location[-1], int):
        location = location[:-1]  # which of several values it was says nothing
    inside = [str(part) for part in location] or ["body"]
    return ".".join(inside[1:] if inside[0] in ("body", "query", "path", "header") else inside) or (
        inside[0] if inside else "body"
    )


def response(problem: Problem, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """The problem as an answer."""
    return JSONResponse(
        problem.document,
        problem.status,
        media_type=MEDIA_TYPE,
        headers=dict(headers) if headers else None,
    )


def of_exception(error: Exception) -> Problem:
    """What to tell a client of an exception; what is our fault is logged and not told."""
    if isinstance(error, Problem):
        return error
    if isinstance(error, RequestValidationError):
        return of_validation(error.errors())
    if isinstance(error, HTTPException):
        code = HTTPStatus(error.status_code).phrase.lower().replace(" ", "_")
        return Problem(error.status_code, code, str(error.detail))
    logger.exception("A request failed", exc_info=error)
    return Problem(500, "internal", "The server failed; its log says why.")


def install(app: FastAPI) -> None:
    """Answers every error of the application with a problem."""

    async def answer(_: Request, error: Exception) -> JSONResponse:
        return response(of_exception(error), getattr(error, "headers", None))

    for kind in (Problem, RequestValidationError, HTTPException, Exception):
        app.add_exception_handler(kind, answer)
