"""What proves who asks: tokens of programs, sign-ins of browsers. Of secrets only hashes are kept.

A secret has 256 random bits, so one SHA-256 is enough; passwords have argon2 (server/users.py).
"""

import hashlib
import hmac
import re
import secrets
from collections.abc import Collection
from datetime import datetime, timedelta

from sqlalchemy import delete, select
from sqlalchemy.orm import Session
from ulid import ULID

from server.access import Principal, Role, Scope
from server.lifecycle import hash_token
from server.models import SignIn, Token, User, now
from server.problems import Problem, invalid, not_found

STAYS = timedelta(days=14)  # of a sign-in
SEEN = timedelta(minutes=5)  # how exactly a token's last use is known
LOCAL = "local"  # id of the token that a server in local mode prints
SHAPE = re.compile(r"hide_([0-9a-z]{5,26})_([A-Za-z0-9_-]{43})")


def new_secret() -> str:
    """256 random bits as text."""
    return secrets.token_urlsafe(32)


def csrf_of(secret: str) -> str:
    """What a form has to show beside the cookie that holds this secret."""
    return hashlib.sha256(f"csrf:{secret}".encode()).hexdigest()


def written(id: str, secret: str) -> str:
    """A token as it is handed out."""
    return f"hide_{id}_{secret}"


def parts(text: str) -> tuple[str, str]:
    """The id and the secret of a token; empty if it is none."""
    found = SHAPE.fullmatch(text)
    return (found[1], found[2]) if found else ("", "")


# --- tokens ---


def create_token(
    session: Session,
    user: User,
    name: str,
    scopes: Collection[Scope],
    expires: datetime | None = None,
) -> tuple[Token, str]:
    """A new token and its text, which is told only now.

    Raises:
        Problem: 422, the user's role does not have a scope, or it would have expired already.
    """
    role = Role(user.role)
    if wrong := sorted(set(scopes) - role.scopes):
        allowed = ", ".join(scope for scope in Scope if scope in role.scopes)
        raise invalid("scopes", f"a {role} may not {wrong[0]}; allowed are {allowed}")
    if expires is not None and expires <= now():
        raise invalid("expires", f"is past; it is {now():%Y-%m-%dT%H:%M:%SZ}")
    secret = new_secret()
    token = Token(
        id=str(ULID()).lower(),
        user_id=user.id,
        name=name,
        secret_hash=hash_token(secret),
        scopes=[scope for scope in Scope if scope in scopes],
        expires=expires,
    )
    session.add(token)
    session.flush()
    return token, written(token.id, secret)


def tokens(session: Session, user: str | None = None) -> list[Token]:
    """Tokens of a user, or of all, the newest first."""
    found = select(Token).order_by(Token.id.desc())
    return list(session.scalars(found.where(Token.user_id == user) if user else found))


def token(session: Session, id: str) -> Token:
    """The token with this id.

    Raises:
        Problem: 404, there is none.
    """
    if found := session.get(Token, id):
        return found
    raise not_found("token", id)


def revoke(row: Token) -> None:
    """Ends a token; one that has ended stays as it is."""
    row.revoked = row.revoked or now()


def of_token(session: Session, id: str, secret: str) -> Principal:
    """Who shows this token.

    Raises:
        Problem: 401, it is wrong, revoked or expired.
    """
    found = session.get(Token, id)
    known = found.secret_hash if found else ""
    if not hmac.compare_digest(known, hash_token(secret)) or found is None:
        raise unauthorised("This token is not known here.")
    if found.revoked or not found.user.active:
        raise unauthorised("This token was revoked.")
    if found.expires and found.expires <= now():
        raise unauthorised(f"This token expired at {found.expires:%Y-%m-%d %H:%M} UTC.")
    user, role = found.user, Role(found.user.role)
    scopes = role.scopes & {Scope(one) for one in found.scopes}
    return Principal(user.id, user.name, role, scopes, via="token", credential=found.id)


def is_stale(session: Session, id: str) -> bool:
    """True if the token's last use should be noted again."""
    used = token(session, id).last_used
    return used is None or now() - used > SEEN


def unauthorised(detail: str) -> Problem:
    """Who asks is not known."""
    return Problem(401, "not_signed_in", detail, headers={"WWW-Authenticate": "Bearer"})


# --- browsers ---


def sign_in(session: Session, user: User) -> str:
    """A new sign-in; the secret that its cookie holds. Expired ones of anybody are forgotten."""
    session.execute(delete(SignIn).where(SignIn.expires <= now()))
    secret = new_secret()
    session.add(SignIn(secret_hash=hash_token(secret), user_id=user.id, expires=now() + STAYS))
    session.flush()
    return secret


def sign_out(session: Session, secret_hash: str) -> None:
    """Ends a sign-in; nothing happens if it has ended."""
    session.execute(delete(SignIn).where(SignIn.secret_hash == secret_hash))


def of_cookie(session: Session, secret: str) -> Principal | None:
    """Whose browser holds this secret; None if it does not let anybody in any more."""
    found = session.get(SignIn, hash_token(secret))
    if found is None or found.expires <= now() or not found.user.active:
        return None
    user, role = found.user, Role(found.user.role)
    return Principal(
        user.id,
        user.name,
        role,
        role.scopes,
        via="session",
        credential=found.secret_hash,
        csrf=csrf_of(secret),
    )
