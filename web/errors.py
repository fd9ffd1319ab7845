"""Error pages: what the API says as a problem, a page says in words, with the same status."""

from collections.abc import Awaitable, Callable
from inspect import isawaitable
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import RedirectResponse, Response

from server.problems import Problem, of_exception
from web.advice import advice
from web.templating import page, query

FOR_PROGRAMS = ("/api/", "/internal/", "/metrics", "/static/", "/viewer/")
Handler = Callable[[Request, Any], Response | Awaitable[Response]]


def show_error_pages(app: FastAPI) -> None:
    """Errors on paths that people read become pages; the others stay as they are."""
    for kind in (Problem, HTTPException, RequestValidationError, Exception):
        app.add_exception_handler(kind, _either(app.exception_handlers.get(kind)))


def _either(for_programs: Handler | None) -> Any:
    async def handle(request: Request, error: Exception) -> Response:
        if for_programs and request.url.path.startswith(FOR_PROGRAMS):
            answer = for_programs(request, error)
            return await answer if isawaitable(answer) else answer
        return error_page(request, error)

    return handle


def error_page(request: Request, error: Exception) -> Response:
    """The page for an error."""
    problem = of_exception(error)
    if problem.status == 401 and request.method == "GET":
        asked = f"{request.url.path}?{request.url.query}".rstrip("?")
        return RedirectResponse(f"/login{query(next=asked)}", 303)
    headers = getattr(error, "headers", None)
    shown = {"problem": problem, "advice": advice(request, problem)}
    return page(request, "error.html", shown, status=problem.status, headers=headers)
