"""Users and their passwords."""

import threading
from typing import Any

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from server.access import Role
from server.models import SignIn, User, new_id, now
from server.models import Token as TokenRow
from server.problems import Problem, invalid, not_found

OWNER = "owner"  # of a server in local mode
SHORTEST, LONGEST = 10, 200  # characters of a password
_hasher = PasswordHasher()  # argon2id with the parameters of RFC 9106 for little memory
_hashing = threading.BoundedSemaphore(2)  # each takes 64 MiB
_NOBODYS = (  # the hash of something random: an unknown name takes as long as a wrong password
    "$argon2id$v=19$m=65536,t=3,p=4$1RF57pz1L0gnMyzM0Og9cQ$"
    "bmw9msXBuC8AtIiKSbD0zNcFQY+Vk6Lz2sZNMShcnIY"
)


def register_owner(session: Session) -> User:
    """The user as whom everything is done in local mode; it never has a password."""
    owner = session.scalar(select(User).where(User.name == OWNER))
    if owner is None:
        owner = User(id=new_id("us"), name=OWNER, role=Role.ADMIN, active=True)
        session.add(owner)
        session.flush()
    return owner


def add(session: Session, name: str, role: Role, password: str | None) -> User:
    """A new user; without a password only tokens let them in.

    Raises:
        Problem: 422, the name is taken or the password is too short.
    """
    if name == OWNER or session.scalar(select(User).where(User.name == name)):
        raise invalid("name", f"'{name}' is taken; choose another")
    user = User(id=new_id("us"), name=name, role=role, active=True)
    session.add(user)
    if password is not None:
        user.password_hash = _hashed(password)
    session.flush()
    return user


def find(session: Session, name: str) -> User:
    """The user of this name.

    Raises:
        Problem: 404, there is none.
    """
    if found := session.scalar(select(User).where(User.name == name)):
        return found
    raise not_found("user", name)


def everyone(session: Session) -> list[User]:
    """All users by name, those who may no longer come in as well."""
    return list(session.scalars(select(User).order_by(User.name)))


def somebody(session: Session) -> bool:
    """True if anybody but the owner of local mode may come in."""
    others = select(User.id).where(User.active, User.name != OWNER).limit(1)
    return session.scalar(others) is not None


def change(session: Session, user: User, **changes: Any) -> None:
    """Sets role, active, quotas or password; what is left out stays.

    Whoever may do less from now on, or has another password, has to sign in again.

    Raises:
        Problem: 409, nobody would be left to administer; 422, the password is too short.
    """
    if "password" in changes:
        user.password_hash = _hashed(changes.pop("password"))
        sign_out_everywhere(session, user)
    for name, value in changes.items():
        setattr(user, name, value)
    if not user.active:
        sign_out_everywhere(session, user)
    session.flush()
    if {"role", "active"} & set(changes):
        _require_an_admin(session)


def _require_an_admin(session: Session) -> None:
    left = select(func.count()).where(User.role == Role.ADMIN, User.active, User.name != OWNER)
    if not session.scalar(left):
        raise Problem(409, "last_admin", "Nobody would be left to administer the server.")


def sign_out_everywhere(session: Session, user: User) -> None:
    """Ends what the user has open; tokens of somebody who may not come in end as well."""
    session.execute(delete(SignIn).where(SignIn.user_id == user.id))
    if not user.active:
        for token in session.scalars(select(TokenRow).where(TokenRow.user_id == user.id)):
            token.revoked = token.revoked or now()


def checked(session: Session, name: str, password: str) -> User | None:
    """The user, if the password is right and they may come in; takes as long if not."""
    user = session.scalar(select(User).where(User.name == name))
    known = user.password_hash if user is not None and user.active else None
    session.rollback()  # the ledger need not wait for a hash
    good = _verified(known or _NOBODYS, password) and known is not None
    return user if good else None


def _verified(known: str, password: str) -> bool:
    try:
        with _hashing:
            return _hasher.verify(known, password[: LONGEST + 1])
    except (VerificationError, InvalidHashError):
        return False


def _hashed(password: str) -> str:
    if not SHORTEST <= len(password) <= LONGEST:
        message = f"has {len(password)} characters; {SHORTEST} to {LONGEST} are wanted"
        raise invalid("password", message)
    with _hashing:
        return _hasher.hash(password)
