"""`hide user` and `hide token` as whoever runs a server meets them."""

import io
from pathlib import Path

import pytest

from server import credentials, users
from server.access import Scope
from server.db import Database
from server.models import AuditEntry
from server.settings import LEDGER
from tests.server.clients import API
from tests.server.people import PASSWORD, application, signed_in, visitor
from tests.server.test_cli import hide


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HIDE_SERVER_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def typed(monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    """Puts a line on standard input."""
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{line}\n"))


def test_a_user_and_a_token_made_here_are_let_in(
    capfd, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed(monkeypatch, PASSWORD)
    added = hide(capfd, "user", "add", "ann", "--role", "admin")
    status, token, _ = hide(capfd, "token", "create", "ann", "--scope", "read", "--days", 3)
    listed = hide(capfd, "user", "list")[1]
    tokens = hide(capfd, "token", "list", "ann")[1]

    app = application(data, auth="users")
    shown = visitor(app, token.strip()).get(f"{API}/me").json()
    browser = signed_in(app, "ann")
    revoked = hide(capfd, "token", "revoke", credentials.parts(token.strip())[0])
    after = visitor(app, token.strip()).get(f"{API}/me")
    app.state.hub.stop()

    assert added[0] == status == revoked[0] == 0
    assert "ann\tadmin\tpassword" in listed
    assert "ann\tcommand line\tread" in tokens and token.strip() not in tokens
    assert (shown["name"], shown["scopes"]) == ("ann", ["read"])
    assert browser.get(f"{API}/me").json()["role"] == "admin"
    assert after.status_code == 401


def test_a_user_is_changed_and_it_is_kept_who_did(
    capfd, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, role in (("ann", "admin"), ("ben", "submitter")):
        hide(capfd, "user", "add", name, "--role", role, "--no-password")
    typed(monkeypatch, PASSWORD)

    status = hide(capfd, "user", "set", "ben", "--role", "viewer", "--scored", 3, "--password")[0]

    database = Database(data / LEDGER)
    with database.reading() as session:
        ben = users.find(session, "ben")
        assert (status, ben.role, ben.scored, ben.attempts) == (0, "viewer", 3, None)
        assert users.checked(session, "ben", PASSWORD) is not None
        entries = [(one.action, one.subject, one.via) for one in session.query(AuditEntry)]
    database.close()
    assert entries[-1] == ("hide user set", "ben: role, scored, password", "command")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("user", "Missing command"),
        ("user add ann", "password: has 5 characters; 10 to 200 are wanted"),
        ("user add a/b", "'a/b' is no name"),
        ("user add owner --no-password", "'owner' is taken"),
        ("user add ann --role god", "'god' is not one of"),
        ("user list", "is no data folder of a server"),
        ("token list", "is no data folder of a server"),
        ("user set ann", "Nothing is to be changed"),
        ("user set nobody --inactive", "No user 'nobody'."),
        ("user set owner --inactive", "owner of local mode stays"),
        ("token create nobody", "No user 'nobody'."),
        ("token revoke nothing", "No token 'nothing'."),
        ("token create owner --days 0", "--days"),
    ],
)
def test_a_mistake_is_one_clear_line_and_changes_nothing(
    capfd, data: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, message: str
) -> None:
    typed(monkeypatch, "short")

    status, output, errors = hide(capfd, *arguments.split())

    assert (status, output) == (2, "")
    assert errors.startswith("hide: ") and message in errors and errors.count("\n") == 1
    if (data / LEDGER).exists():
        database = Database(data / LEDGER)
        with database.reading() as session:
            assert [one.name for one in users.everyone(session)] in ([], [users.OWNER])
        database.close()


@pytest.mark.usefixtures("data")
def test_a_token_has_no_more_than_its_users_role(capfd) -> None:
    hide(capfd, "user", "add", "eve", "--role", "viewer", "--no-password")

    status, output, errors = hide(capfd, "token", "create", "eve", "--scope", Scope.SUBMIT)

    assert (status, output) == (2, "")
    assert "a viewer may not submit; allowed are read" in errors
