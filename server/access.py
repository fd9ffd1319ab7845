"""What a route needs of whoever asks, and who has it.

Every route says so with `needs`; one that does not is no route: `Router` refuses it when it is
made, and an application with a route of another kind does not start.
"""

from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, TypeVar

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import Response
from fastapi.routing import APIRoute, iter_route_contexts

from server.problems import Problem
from server.revalidation import revalidated

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])
NO_ROUTES = ("/static", "/api/v1/openapi.json")  # files and the description, open to anybody


class Scope(StrEnum):
    """What a token may be allowed to do."""

    READ = "read"  # see everything but people
    SUBMIT = "submit"  # hand in policies, ask for evaluations, stop one's own
    MAINTAIN = "maintain"  # stop others' evaluations, let some go first
    ADMIN = "admin"  # users, quotas, the audit log
    WORK = "worker"  # join the cluster, which runs whatever its members send each other


class Gate(StrEnum):
    """What is no matter of scopes."""

    PUBLIC = "public"  # anybody, signed in or not
    ANYONE = "anyone"  # whoever is known, with whatever scopes
    WORKER = "worker"  # an attempt's own token (server/deps.py), and no user's


Need = Scope | Gate


class Role(StrEnum):
    """What a user may do at most; each may do what those before it may."""

    VIEWER = "viewer"
    SUBMITTER = "submitter"
    MAINTAINER = "maintainer"
    ADMIN = "admin"

    @property
    def scopes(self) -> frozenset[Scope]:
        """Everything that the role allows."""
        if self is Role.ADMIN:
            return frozenset(Scope)
        return frozenset(list(Scope)[: list(Role).index(self) + 1])


@dataclass(frozen=True)
class Principal:
    """Who asks, and how that is known."""

    user: str  # id
    name: str
    role: Role
    scopes: frozenset[Scope]
    via: Literal["local", "session", "token"]
    credential: str = ""  # id of the token, hash of the session's secret
    csrf: str = ""  # what forms of a session have to show

    def may(self, scope: Scope) -> bool:
        """True if it is allowed."""
        return scope in self.scopes

    def may_ever(self, scope: Scope) -> bool:
        """True if the role allows it, whatever the token at hand is for."""
        return scope in self.role.scopes

    def require_own(self, owner: str | None, what: str) -> None:
        """Does nothing if the thing is the principal's own, or others' are allowed.

        Raises:
            Problem: 403, it is somebody else's.
        """
        if owner != self.user and not self.may(Scope.MAINTAIN):
            raise Problem(403, "not_yours", f"{what} is not yours; a maintainer may change it.")


def needs(need: Need) -> Callable[[Endpoint], Endpoint]:
    """Says what an endpoint needs; stands below the route's decorator."""

    def declare(endpoint: Endpoint) -> Endpoint:
        endpoint.__needs__ = need  # type: ignore[attr-defined]
        return endpoint

    return declare


class GuardedRoute(APIRoute):
    """A route that is asked for leave before anything of the request's body is read.

    Raises:
        TypeError: its endpoint does not say what it needs.
    """

    @property
    def need(self) -> Need:
        """What its endpoint declares."""
        need: Need | None = getattr(self.endpoint, "__needs__", None)
        if need is None:
            raise TypeError(f"{self.path}: {self.endpoint.__name__} lacks @needs(…)")
        return need

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        need, handle = self.need, super().get_route_handler()

        async def guarded(request: Request) -> Response:
            admit: Admit = request.app.state.admit
            return revalidated(request, await admit(request, need, handle))

        return guarded


Handle = Callable[[Request], Awaitable[Response]]
Admit = Callable[[Request, Need, Handle], Awaitable[Response]]


class Router(APIRouter):
    """An APIRouter whose routes say what they need."""

    def __init__(self, **settings: Any):
        super().__init__(route_class=GuardedRoute, **settings)


def undeclared(app: FastAPI) -> list[str]:
    """Paths that anybody would get to by accident."""
    return [
        str(found.path)
        for found in iter_route_contexts(app.routes)
        if not isinstance(found.original_route, GuardedRoute) and found.path not in NO_ROUTES
    ]


def declared(app: FastAPI) -> dict[tuple[str, str], Need]:
    """What is needed, by path and method in small letters."""
    return {
        (str(found.path), method.lower()): found.original_route.need
        for found in iter_route_contexts(app.routes)
        if isinstance(found.original_route, GuardedRoute)
        for method in found.original_route.methods or ()
    }


def require_declared(app: FastAPI) -> None:
    """Does nothing if every route says what it needs.

    Raises:
        TypeError: some do not.
    """
    if found := undeclared(app):
        raise TypeError(f"Routes that do not say what they need: {', '.join(found)}")
