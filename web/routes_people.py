"""Who may come in, and what everybody did; for administrators."""

from typing import Annotated

from fastapi import Form, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import ValidationError

from server import audit, users
from server.access import Role, Router, Scope, needs
from server.deps import Cursor, Reading, TheHub
from server.hub import Hub
from server.problems import Problem, of_validation
from server.routes import people as api
from server.schemas.people import UserChange, UserCreate
from web.templating import page

PATH = "/people"
router = Router(prefix=PATH, include_in_schema=False)

LISTED = 50
Text = Annotated[str, Form(max_length=200)]


@router.get("")
@needs(Scope.ADMIN)
def list_people(request: Request, hub: TheHub, cursor: Cursor = None) -> HTMLResponse:
    """Everybody by name, and the form that adds somebody."""
    return _list(request, hub, cursor)


@router.post("")
@needs(Scope.ADMIN)
def add_person(
    request: Request,
    hub: TheHub,
    role: Annotated[Role, Form()],
    name: Text = "",
    password: Text = "",
) -> Response:
    """Somebody new; one without a password comes in by tokens alone."""
    try:
        wanted = UserCreate.model_validate(
            {"name": name.strip(), "role": role, "password": password or None}
        )
        api.create_user(wanted, hub, Response())
    except ValidationError as error:
        return _list(request, hub, problem=of_validation(error.errors()), given=name)
    except Problem as problem:
        return _list(request, hub, problem=problem, given=name)
    return RedirectResponse(PATH, 303)


@router.post("/{user}/changes")
@needs(Scope.ADMIN)
def change_person(
    request: Request,
    hub: TheHub,
    user: str,
    role: Annotated[Role | None, Form()] = None,
    active: Annotated[bool | None, Form()] = None,
) -> Response:
    """Another role, or whether they may come in."""
    given = {"role": role, "active": active}
    changes = {name: value for name, value in given.items() if value is not None}
    try:
        api.change_user(user, UserChange.model_validate(changes), hub)
    except Problem as problem:
        return _list(request, hub, problem=problem)
    return RedirectResponse(PATH, 303)


@router.get("/audit")
@needs(Scope.ADMIN)
def show_audit(
    request: Request,
    session: Reading,
    user: Annotated[str, Query(max_length=80)] = "",
    cursor: Cursor = None,
) -> HTMLResponse:
    """Who changed what, and who was refused, the newest first."""
    shown = {
        "found": audit.listed(session, user=user or None, limit=LISTED, cursor=cursor),
        "names": [one.name for one in users.everyone(session)],
        "user": user,
        "cursor": cursor,
    }
    return page(request, "audit.html", shown)


def _list(
    request: Request,
    hub: Hub,
    cursor: str | None = None,
    *,
    problem: Problem | None = None,
    given: str = "",
) -> HTMLResponse:
    with hub.database.reading() as session:
        found = api.list_users(session, hub, limit=LISTED, cursor=cursor)
    shown = {
        "found": found,
        "cursor": cursor,
        "roles": list(Role),
        "owner": users.OWNER,
        "shortest": users.SHORTEST,
        "given": given,
        "problem": problem.detail if problem else "",
    }
    return page(request, "people.html", shown, status=problem.status if problem else 200)
