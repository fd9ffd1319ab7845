"""Signing in and out, and what is one's own: password, quotas, tokens."""

import hmac
import re
from datetime import timedelta
from typing import Annotated

from fastapi import Form, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from sqlalchemy.orm import Session

from server import credentials, quotas, users
from server.access import Gate, Principal, Router, Scope, needs
from server.admission import Admission, cookie_name
from server.credentials import csrf_of, new_secret
from server.deps import Reading, TheHub, ThePrincipal
from server.hub import Hub
from server.models import User, now
from server.problems import Problem
from server.routes.people import public_token
from web.templating import page

router = Router(include_in_schema=False)

OWN_PATH = re.compile(r"/(?![/\\])[^\\\x00-\x20]*")  # leads nowhere else in any browser
MOST_DAYS = 3650
Text = Annotated[str, Form(max_length=200)]


def own_path(text: str) -> str:
    """The path if it is one of this server, else the first page."""
    return text if OWN_PATH.fullmatch(text) else "/"


@router.get("/login")
@needs(Gate.PUBLIC)
def show_sign_in(
    request: Request,
    hub: TheHub,
    next: Annotated[str, Query(max_length=2000)] = "/",
    token: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    """The form to sign in; the link that a server in local mode prints does it at once."""
    if hub.settings.is_open:
        return RedirectResponse(own_path(next), 303)
    return _try(request, hub, users.OWNER, token, next) if token else _form(request, hub, next)


@router.post("/login")
@needs(Gate.PUBLIC)
def sign_in(
    request: Request,
    hub: TheHub,
    csrf: Text = "",
    name: Text = "",
    password: Text = "",
    next: Annotated[str, Form(max_length=2000)] = "/",
) -> Response:
    """Lets a browser in, or says why not."""
    expected = csrf_of(request.cookies.get(_form_cookie(hub), ""))
    if not hmac.compare_digest(csrf.encode(), expected.encode()):
        too_old = "The form was too old; try again."
        return _form(request, hub, next, too_old, name=name, status=403)
    local = hub.settings.auth == "local"
    return _try(request, hub, users.OWNER if local else name, password, next)


def _try(request: Request, hub: Hub, name: str, password: str, next: str) -> Response:
    try:
        return _enter(request, hub, name, password, next)
    except Problem as problem:
        status, headers = problem.status, problem.headers
        return _form(request, hub, next, problem.detail, name=name, status=status, headers=headers)


def _enter(request: Request, hub: Hub, name: str, password: str, next: str) -> Response:
    admission: Admission = request.app.state.admit
    secret = admission.sign_in(request, name, password)
    response = RedirectResponse(own_path(next), 303)
    response.delete_cookie(_form_cookie(hub), secure=hub.settings.secure)
    _give(response, hub, secret)
    return response


def _give(response: Response, hub: Hub, secret: str) -> None:
    response.set_cookie(
        cookie_name(hub),
        secret,
        max_age=int(credentials.STAYS.total_seconds()),
        secure=hub.settings.secure,
        httponly=True,
        samesite="lax",
    )


def _form_cookie(hub: Hub) -> str:
    """What ties the form to the browser that got it: nobody is signed in unawares."""
    return f"{cookie_name(hub)}-form"


def _form(
    request: Request,
    hub: Hub,
    next: str,
    problem: str = "",
    *,
    name: str = "",
    status: int = 200,
    headers: dict[str, str] | None = None,
) -> Response:
    secret = request.cookies.get(_form_cookie(hub)) or new_secret()
    shown = {
        "next": own_path(next),
        "problem": problem,
        "name": name,
        "csrf": csrf_of(secret),
        "local": hub.settings.auth == "local",
    }
    response = page(request, "login.html", shown, status=status, headers=headers)
    secure = hub.settings.secure
    response.set_cookie(_form_cookie(hub), secret, secure=secure, httponly=True, samesite="lax")
    return response


@router.post("/logout")
@needs(Gate.ANYONE)
def sign_out(principal: ThePrincipal, hub: TheHub) -> Response:
    """Ends the browser's sign-in."""
    with hub.database.writing() as session:
        credentials.sign_out(session, principal.credential)
    response = RedirectResponse("/login", 303)
    response.delete_cookie(cookie_name(hub), secure=hub.settings.secure, httponly=True)
    return response


# --- what is one's own ---


@router.get("/account")
@needs(Gate.ANYONE)
def show_account(
    request: Request, principal: ThePrincipal, hub: TheHub, session: Reading
) -> HTMLResponse:
    """Quotas, tokens, password."""
    return _account(request, principal, hub, session)


@router.post("/account/password")
@needs(Gate.ANYONE)
def change_password(
    request: Request, principal: ThePrincipal, hub: TheHub, old: Text = "", new: Text = ""
) -> Response:
    """Another password; every other browser of the user is signed out."""
    admission: Admission = request.app.state.admit
    try:
        if principal.via != "session":
            raise Problem(403, "not_allowed", "A password is changed in a browser.")
        admission.require_password(request, principal.name, old)
        with hub.database.writing() as session:
            user = session.get_one(User, principal.user)
            users.change(session, user, password=new)
            secret = credentials.sign_in(session, user)
    except Problem as problem:
        with hub.database.reading() as session:
            return _account(request, principal, hub, session, problem=problem)
    response = RedirectResponse("/account", 303)
    _give(response, hub, secret)
    return response


@router.post("/account/tokens")
@needs(Gate.ANYONE)
def create_token(
    request: Request,
    principal: ThePrincipal,
    hub: TheHub,
    name: Annotated[str, Form(min_length=1, max_length=80)],
    scopes: Annotated[list[Scope], Form()],
    days: Annotated[int, Form(ge=1, le=MOST_DAYS)] = 90,
) -> Response:
    """A new token, shown on this page and never again."""
    if wrong := [scope for scope in scopes if not principal.may(scope)]:
        raise Problem(403, "not_allowed", f"You may not {wrong[0]}.")
    with hub.database.writing() as session:
        user = session.get_one(User, principal.user)
        expires = now() + timedelta(days=days)
        _, text = credentials.create_token(session, user, name, scopes, expires)
    with hub.database.reading() as session:
        return _account(request, principal, hub, session, token=text)


@router.post("/account/tokens/{token}/revocation")
@needs(Gate.ANYONE)
def revoke_token(token: str, principal: ThePrincipal, hub: TheHub) -> Response:
    """Ends a token of one's own."""
    with hub.database.writing() as session:
        row = credentials.token(session, token)
        if row.user_id == principal.user:
            credentials.revoke(row)
    return RedirectResponse("/account", 303)


def _account(
    request: Request,
    principal: Principal,
    hub: Hub,
    session: Session,
    *,
    token: str = "",
    problem: Problem | None = None,
) -> HTMLResponse:
    user = session.get_one(User, principal.user)
    bound = quotas.is_bound(principal, hub.settings)
    shown = {
        "quotas": quotas.of(session, user, hub.settings, bound=bound),
        "tokens": [public_token(one) for one in credentials.tokens(session, user.id)],
        "has_password": user.password_hash is not None,
        "shortest": users.SHORTEST,
        "most_days": MOST_DAYS,
        "scopes": [scope for scope in Scope if principal.may(scope)],
        "new_token": token,
        "problem": problem.detail if problem else "",
    }
    headers = {"Cache-Control": "no-store", **(problem.headers if problem else {})}
    status = problem.status if problem else 200
    return page(request, "account.html", shown, status=status, headers=headers)
