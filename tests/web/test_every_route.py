"""No route is open by accident: each says what it needs, and is asked by everybody."""

from collections.abc import Iterator
from typing import NamedTuple

import pytest
from fastapi import FastAPI
from fastapi.routing import iter_route_contexts

from server.access import (
    NO_ROUTES,
    Gate,
    GuardedRoute,
    Need,
    Role,
    Router,
    Scope,
    needs,
    require_declared,
    undeclared,
)
from tests.server.people import application, peopled, token_of, visitor

OPEN = {  # whoever adds to these says why in the review
    ("GET", "/api/v1/health/live"),
    ("GET", "/api/v1/health/ready"),
    ("GET", "/api/v1/version"),
    ("GET", "/favicon.ico"),
    ("GET", "/login"),
    ("POST", "/login"),
    ("OPTIONS", "/api/v1/uploads"),
}
UNKNOWN, FORBIDDEN = 401, 403
FOR_PROGRAMS = ("/api/", "/internal/", "/metrics", "/viewer/")


class Asked(NamedTuple):
    """A route and how it is asked."""

    method: str
    path: str
    need: Need

    @property
    def example(self) -> str:
        """The path with something for each of its parameters."""
        return self.path.replace("{", "").replace("}", "")


def routes(app: FastAPI) -> list[Asked]:
    """Everything that the application routes by itself, pages and workers' routes as well."""
    return [
        Asked(method, str(found.path), found.original_route.need)
        for found in iter_route_contexts(app.routes)
        if isinstance(found.original_route, GuardedRoute)
        for method in sorted(found.methods or ())
    ]


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    with peopled(tmp_path_factory.mktemp("routes"), rate="100000/minute") as found:
        yield found


def test_every_route_says_what_it_needs(app: FastAPI) -> None:
    others = [
        found.path
        for found in iter_route_contexts(app.routes)
        if not isinstance(found.original_route, GuardedRoute)
    ]

    assert sorted(others) == sorted(NO_ROUTES)
    assert undeclared(app) == []
    assert len(routes(app)) > 45


def test_what_is_open_to_anybody_is_meant_to_be(app: FastAPI) -> None:
    found = {(one.method, one.path) for one in routes(app) if one.need is Gate.PUBLIC}

    assert found == OPEN


def test_only_what_workers_report_is_theirs(app: FastAPI) -> None:
    for one in routes(app):
        assert (one.need is Gate.WORKER) == one.path.startswith("/internal/"), one


@pytest.mark.parametrize("credential", [None, "nonsense", "hide_local_" + "x" * 43])
def test_a_stranger_gets_nowhere(app: FastAPI, credential: str | None) -> None:
    stranger = visitor(app, credential)
    app.state.admit._limiter.storage.reset()

    for one in routes(app):
        answer = stranger.request(one.method, one.example, content=b"{")
        if one.need is Gate.PUBLIC and credential is None:
            assert answer.status_code not in (UNKNOWN,), one
        elif one.method == "GET" and not one.path.startswith(FOR_PROGRAMS):
            assert answer.status_code == 303, one
            assert answer.headers["location"].startswith("/login?next=%2F"), one
        else:
            assert answer.status_code == UNKNOWN, one
        if answer.status_code == UNKNOWN and not one.path.startswith("/internal/"):
            assert answer.headers["www-authenticate"] == "Bearer", one
        app.state.admit._limiter.storage.reset()


@pytest.mark.parametrize("role", list(Role))
def test_a_role_gets_as_far_as_it_may(app: FastAPI, role: Role) -> None:
    asking = visitor(app, token_of(app, role.value))

    for one in routes(app):
        status = asking.request(one.method, one.example, content=b"{").status_code
        _expect(one, status, allowed=one.need in role.scopes)


@pytest.mark.parametrize("scope", list(Scope))
def test_a_token_gets_as_far_as_its_scope_says(app: FastAPI, scope: Scope) -> None:
    asking = visitor(app, token_of(app, "admin", [scope]))

    for one in routes(app):
        status = asking.request(one.method, one.example, content=b"{").status_code
        _expect(one, status, allowed=one.need is scope)


def _expect(one: Asked, status: int, *, allowed: bool) -> None:
    if one.need is Gate.WORKER:
        assert status == UNKNOWN, one
    elif isinstance(one.need, Scope) and not allowed:
        assert status == FORBIDDEN, one
    elif one.path == "/login" or one.path.startswith("/account/"):
        assert status in (200, 303, 403, 404, 422), one  # what a form says of itself
    else:
        assert status not in (UNKNOWN, FORBIDDEN), one


def test_on_this_machine_alone_nothing_is_asked_for(tmp_path) -> None:
    app = application(tmp_path)
    asking = visitor(app)

    for one in routes(app):
        status = asking.request(one.method, one.example, content=b"{").status_code
        if one.path == "/account/password" or one.need is Gate.WORKER:
            assert status in (UNKNOWN, FORBIDDEN), one
        elif one.path != "/login":
            assert status not in (UNKNOWN, FORBIDDEN), one
    app.state.hub.stop()


def test_a_route_that_says_nothing_is_none() -> None:
    router = Router()

    with pytest.raises(TypeError, match=r"/open: forgotten lacks @needs"):

        @router.get("/open")
        def forgotten() -> None: ...


def test_an_application_with_another_kind_of_route_does_not_start(tmp_path) -> None:
    app = application(tmp_path)

    @app.get("/open")
    def forgotten() -> None: ...

    with pytest.raises(TypeError, match="do not say what they need: /open"):
        require_declared(app)
    with pytest.raises(TypeError), visitor(app):
        pass


def test_needs_is_kept_by_the_endpoint() -> None:
    router = Router()

    @router.get("/read")
    @needs(Scope.READ)
    def read() -> None: ...

    [route] = router.routes
    assert isinstance(route, GuardedRoute) and route.need is Scope.READ
