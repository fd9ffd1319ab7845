"""Who asks, their tokens, the users, and what everybody did."""

from typing import Annotated

from fastapi import Query, Response
from sqlalchemy import select

from server import audit, credentials, quotas, users
from server.access import Gate, Principal, Role, Router, Scope, needs
from server.deps import Cursor, Limit, Reading, TheHub, ThePrincipal
from server.models import Token, User
from server.paging import after, page
from server.problems import Problem, invalid, not_found
from server.schemas.common import Page
from server.schemas.people import (
    AuditEntryPublic,
    Me,
    TokenCreate,
    TokenCreated,
    TokenPublic,
    UserChange,
    UserCreate,
    UserPublic,
)

router = Router(tags=["people"])


@router.get("/me")
@needs(Gate.ANYONE)
def get_me(principal: ThePrincipal, session: Reading, hub: TheHub) -> Me:
    """Who asks, what they may do, and how much of their quotas is used."""
    user = session.get_one(User, principal.user)
    bound = quotas.is_bound(principal, hub.settings)
    return Me(
        name=principal.name,
        role=principal.role,
        scopes=[scope for scope in Scope if principal.may(scope)],
        via=principal.via,
        quotas=quotas.of(session, user, hub.settings, bound=bound),
    )


# --- tokens ---


@router.get("/tokens")
@needs(Gate.ANYONE)
def list_tokens(
    principal: ThePrincipal, session: Reading, limit: Limit = 50, cursor: Cursor = None
) -> Page[TokenPublic]:
    """One's own tokens, the newest first, ended ones as well; nobody learns a secret again."""
    wanted = select(Token).where(Token.user_id == principal.user).order_by(Token.id.desc())
    if place := after(cursor, [str]):
        wanted = wanted.where(Token.id < place[0])
    rows = session.scalars(wanted.limit(limit + 1)).all()
    return page(rows, limit, lambda one: [one.id], public_token)


@router.post("/tokens", status_code=201)
@needs(Gate.ANYONE)
def create_token(
    wanted: TokenCreate, principal: ThePrincipal, hub: TheHub, response: Response
) -> TokenCreated:
    """A new token of one's own, with no more scopes than one has here. It is told only now."""
    if wrong := [scope for scope in wanted.scopes if not principal.may(scope)]:
        raise invalid("scopes", f"you may not {wrong[0]} with what you show now")
    with hub.database.writing() as session:
        user = session.get_one(User, principal.user)
        row, text = credentials.create_token(
            session, user, wanted.name, wanted.scopes, wanted.expires
        )
        public = public_token(row)
    response.headers["Location"] = f"/api/v1/tokens/{public.id}"
    return TokenCreated(**public.model_dump(), token=text)


@router.get("/tokens/{token}")
@needs(Gate.ANYONE)
def get_token(token: str, principal: ThePrincipal, session: Reading) -> TokenPublic:
    """One token of one's own."""
    return public_token(_own_token(credentials.token(session, token), principal))


@router.post("/tokens/{token}/revocation")
@needs(Gate.ANYONE)
def revoke_token(token: str, principal: ThePrincipal, hub: TheHub) -> TokenPublic:
    """Ends a token at once. An administrator may end anybody's."""
    with hub.database.writing() as session:
        row = _own_token(credentials.token(session, token), principal)
        credentials.revoke(row)
        return public_token(row)


def _own_token(row: Token, principal: Principal) -> Token:
    """The token, if it is one's own; others' are not there but for administrators."""
    if row.user_id != principal.user and not principal.may(Scope.ADMIN):
        raise not_found("token", row.id)
    return row


def public_token(row: Token) -> TokenPublic:
    """A token as the API gives it out: without its secret."""
    return TokenPublic(
        id=row.id,
        user=row.user.name,
        name=row.name,
        scopes=[Scope(one) for one in row.scopes],
        created=row.created,
        expires=row.expires,
        last_used=row.last_used,
        revoked=row.revoked,
    )


# --- users ---


@router.get("/users")
@needs(Scope.ADMIN)
def list_users(
    session: Reading, hub: TheHub, limit: Limit = 50, cursor: Cursor = None
) -> Page[UserPublic]:
    """Everybody, by name."""
    wanted = select(User).order_by(User.name).limit(limit + 1)
    if place := after(cursor, [str]):
        wanted = wanted.where(User.name > place[0])
    rows = session.scalars(wanted).all()
    return page(rows, limit, lambda one: [one.name], lambda one: _public_user(hub, session, one))


@router.post("/users", status_code=201)
@needs(Scope.ADMIN)
def create_user(wanted: UserCreate, hub: TheHub, response: Response) -> UserPublic:
    """A new user; one without a password comes in by tokens alone."""
    password = wanted.password.get_secret_value() if wanted.password else None
    with hub.database.writing() as session:
        row = users.add(session, wanted.name, wanted.role, password)
        public = _public_user(hub, session, row)
    response.headers["Location"] = f"/api/v1/users/{public.name}"
    return public


@router.get("/users/{user}")
@needs(Scope.ADMIN)
def get_user(user: str, session: Reading, hub: TheHub) -> UserPublic:
    """One user."""
    return _public_user(hub, session, users.find(session, user))


@router.post("/users/{user}/changes")
@needs(Scope.ADMIN)
def change_user(user: str, wanted: UserChange, hub: TheHub) -> UserPublic:
    """Sets what is given: role, password, quotas, whether they may come in."""
    if user == users.OWNER:
        raise Problem(409, "owner", "The owner of local mode stays as it is.")
    changes = wanted.model_dump(exclude_unset=True)
    if (password := changes.pop("password", None)) is not None:
        changes["password"] = password.get_secret_value()
    with hub.database.writing() as session:
        row = users.find(session, user)
        users.change(session, row, **changes)
        return _public_user(hub, session, row)


def _public_user(hub: TheHub, session: Reading, row: User) -> UserPublic:
    bound = hub.settings.auth == "users" and Scope.MAINTAIN not in Role(row.role).scopes
    return UserPublic(
        name=row.name,
        role=Role(row.role),
        active=row.active,
        has_password=row.password_hash is not None,
        created=row.created,
        quotas=quotas.of(session, row, hub.settings, bound=bound),
    )


@router.get("/audit")
@needs(Scope.ADMIN)
def list_audit(
    session: Reading,
    user: Annotated[str | None, Query(max_length=80)] = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[AuditEntryPublic]:
    """Who changed what, and who was refused, the newest first."""
    return audit.listed(session, user=user, limit=limit, cursor=cursor)
