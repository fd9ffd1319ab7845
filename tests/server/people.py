"""A server whose users sign in, with one of each role, for tests."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from server import credentials, users
from server.access import Role, Scope
from server.hub import Hub
from server.settings import Settings
from tests import viewer_files
from tests.server import ledgers
from tests.server.clients import TestClient
from web.app import create_app

PASSWORD = "correct horse battery"  # of everybody
LOOPBACK = "http://127.0.0.1"


def application(data: Path, **settings: Any) -> FastAPI:
    """The API and its pages; nothing is handed out."""
    ledgers.laid(data)
    viewer_files.lay(data)
    quiet = {"workers": 0, "references": False, "smoke": False, "trained": data / "no-trained"}
    return create_app(Settings(data=data, **{**quiet, **settings}))


@contextmanager
def peopled(data: Path, **settings: Any) -> Iterator[FastAPI]:
    """The application in users mode, with a user of each role, named after it."""
    app = application(data, auth="users", **settings)
    with app.state.hub.database.writing() as session:
        for role in Role:
            users.add(session, role.value, role, None)
    with TestClient(app, base_url=LOOPBACK):
        yield app


def token_of(app: FastAPI, name: str, scopes: Sequence[Scope] | None = None, **kept: Any) -> str:
    """A new token of a user, with all that their role has unless scopes are given."""
    hub: Hub = app.state.hub
    with hub.database.writing() as session:
        user = users.find(session, name)
        wanted = list(Role(user.role).scopes) if scopes is None else scopes
        return credentials.create_token(session, user, "test", wanted, **kept)[1]


def bearer(token: str) -> dict[str, str]:
    """The header that shows a token."""
    return {"Authorization": f"Bearer {token}"}


def visitor(app: FastAPI, token: str | None = None, base_url: str = LOOPBACK) -> TestClient:
    """A client that follows no redirects and shows a token, or nothing."""
    headers = bearer(token) if token else {}
    return TestClient(app, base_url=base_url, follow_redirects=False, headers=headers)


def with_password(app: FastAPI, name: str) -> None:
    """Gives a user the password."""
    hub: Hub = app.state.hub
    with hub.database.writing() as session:
        users.change(session, users.find(session, name), password=PASSWORD)


def form_of(page: str) -> str:
    """What a page's forms have to show."""
    return page.partition('name="csrf" value="')[2].partition('"')[0]


def signed_in(app: FastAPI, name: str, base_url: str = LOOPBACK) -> TestClient:
    """A browser in which a user with the password has signed in."""
    browser = visitor(app, base_url=base_url)
    csrf = form_of(browser.get("/login").text)
    answer = browser.post("/login", data={"csrf": csrf, "name": name, "password": PASSWORD})
    assert answer.status_code == 303, answer.text
    return browser
