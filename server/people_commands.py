"""`hide user` and `hide token`: who may use a server, said on the machine that runs it.

They write to the data folder's ledger, whether its server runs or not.
"""

import getpass
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from server.arguments import BadUsage, settings_of

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

user = typer.Typer(help="The users of a server that runs with --auth users.")
token = typer.Typer(help="Tokens, which programs show to a server.")


class RoleName(StrEnum):
    viewer = "viewer"
    submitter = "submitter"
    maintainer = "maintainer"
    admin = "admin"


class ScopeName(StrEnum):
    read = "read"
    submit = "submit"
    maintain = "maintain"
    admin = "admin"
    worker = "worker"


Data = Annotated[Path | None, Option(help="The server's folder. Default: data")]
Name = Annotated[str, Argument(metavar="NAME", help="Of the user.")]
AsksPassword = Annotated[
    bool, Option("--password", help="Ask for a new password, or read it from standard input.")
]


@user.command("add")
def add_user(
    name: Name,
    role: Annotated[RoleName, Option(help="What they may do.")] = RoleName.submitter,
    password: Annotated[
        bool, Option("--password/--no-password", help="Without one, tokens alone let them in.")
    ] = True,
    data: Data = None,
) -> None:
    """Add a user. The password is asked for, or read from standard input if that is no terminal."""
    from pydantic import TypeAdapter, ValidationError

    from server import users
    from server.access import Role
    from server.schemas.people import UserName

    try:
        TypeAdapter(UserName).validate_python(name)
    except ValidationError:
        raise BadUsage(
            f"'{name}' is no name: up to 80 letters, digits and _ . @ + -, a letter or digit first."
        ) from None
    secret = _password() if password else None
    with _ledger(data, "hide user add", name) as session:
        users.add(session, name, Role(role.value), secret)
    typer.echo(f"{name}: {role.value}.", err=True)


@user.command("set")
def set_user(
    name: Name,
    role: Annotated[RoleName | None, Option(help="What they may do.")] = None,
    active: Annotated[
        bool | None, Option("--active/--inactive", help="Whether they may come in.")
    ] = None,
    attempts: Annotated[int | None, Option(min=0, help="Evaluations in 24 hours.")] = None,
    scored: Annotated[int | None, Option(min=0, help="Scored evaluations in 30 days.")] = None,
    storage: Annotated[int | None, Option(min=0, help="Bytes of checkpoints.")] = None,
    password: AsksPassword = False,
    data: Data = None,
) -> None:
    """Change a user; what is left out stays. A new password ends all their sign-ins."""
    from server import users

    given: dict[str, Any] = {
        "role": role and role.value,
        "active": active,
        "attempts": attempts,
        "scored": scored,
        "storage": storage,
        "password": _password() if password else None,
    }
    changes = {what: value for what, value in given.items() if value is not None}
    if not changes:
        raise BadUsage("Nothing is to be changed; see hide user set --help.")
    with _ledger(data, "hide user set", f"{name}: {', '.join(changes)}") as session:
        if name == users.OWNER:
            raise BadUsage("The owner of local mode stays as it is.")
        users.change(session, users.find(session, name), **changes)
    typer.echo(f"{name} is changed.", err=True)


@user.command("list")
def list_users(data: Data = None) -> None:
    """List the users."""
    from server import users

    with _ledger(data) as session:
        for one in users.everyone(session):
            comes_in = "password" if one.password_hash else "tokens"
            typer.echo(f"{one.name}\t{one.role}\t{comes_in if one.active else 'inactive'}")


@token.command("create")
def create_token(
    name: Annotated[str, Argument(metavar="USER", help="As whom it acts.")],
    label: Annotated[str, Option("--name", help="What it is for.")] = "",
    scope: Annotated[
        list[ScopeName] | None, Option(help="What it may do, once for each. Default: read, submit")
    ] = None,
    days: Annotated[int | None, Option(min=1, max=3650, help="Until it expires.")] = None,
    data: Data = None,
) -> None:
    """Make a token and print it; it cannot be told again."""
    from server import credentials, users
    from server.access import Scope
    from server.models import now

    scopes = [Scope(one.value) for one in scope or (ScopeName.read, ScopeName.submit)]
    with _ledger(data, "hide token create", name) as session:
        row = users.find(session, name)
        expires = now() + timedelta(days=days) if days else None
        _, text = credentials.create_token(session, row, label or "command line", scopes, expires)
    typer.echo(text)


@token.command("list")
def list_tokens(
    name: Annotated[str | None, Argument(metavar="USER", help="Whose; default: all.")] = None,
    data: Data = None,
) -> None:
    """List tokens, without their secrets."""
    from server import credentials, users

    with _ledger(data) as session:
        owner = users.find(session, name).id if name else None
        for one in credentials.tokens(session, owner):
            until = "revoked" if one.revoked else f"{one.expires:%Y-%m-%d}" if one.expires else "–"
            scopes = ",".join(one.scopes)
            typer.echo(f"{one.id}\t{one.user.name}\t{one.name}\t{scopes}\t{until}")


@token.command("revoke")
def revoke_token(
    id: Annotated[str, Argument(metavar="ID", help="The part between hide_ and the next _.")],
    data: Data = None,
) -> None:
    """End a token at once."""
    from server import credentials

    with _ledger(data, "hide token revoke", id) as session:
        credentials.revoke(credentials.token(session, id))


@contextmanager
def _ledger(data: Path | None, action: str = "", subject: str = "") -> Iterator["Session"]:
    """The ledger, in one transaction; what is changed enters the audit log."""
    from server import audit, users
    from server.db import Database, LedgerError
    from server.problems import Problem

    settings = settings_of({"data": data})
    if not action and isinstance(settings.ledger, Path) and not settings.ledger.exists():
        raise BadUsage(f"{settings.data} is no data folder of a server; hide user add makes one.")
    settings.data.mkdir(parents=True, exist_ok=True)
    try:
        database = Database(settings.ledger)
    except LedgerError as error:
        raise BadUsage(str(error)) from None
    try:
        with database.writing() as session:
            users.register_owner(session)
            yield session
            if action:
                who = getpass.getuser()
                audit.note(session, action, subject, principal=None, name=who, via="command")
    except Problem as problem:
        raise BadUsage(problem.detail) from None
    finally:
        database.close()


def _password() -> str:
    if sys.stdin.isatty():
        asked: str = typer.prompt("Password", hide_input=True, confirmation_prompt=True, err=True)
        return asked
    return sys.stdin.readline().rstrip("\n")
