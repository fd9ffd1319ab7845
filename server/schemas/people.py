"""Who asks: users, tokens, quotas, the audit log."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, SecretStr, StrictBool

from server.access import Role, Scope
from server.schemas.common import Given

UserName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,79}$")]
Most = Annotated[int, Field(ge=0, lt=2**31, strict=True)] | None  # null: as the settings say
MostBytes = Annotated[int, Field(ge=0, lt=2**63, strict=True)] | None
Password = Annotated[SecretStr, Field(max_length=200)]


class Quota(BaseModel):
    """How much of something is used, and how much may be."""

    used: int
    limit: int | None  # null: without bound


class Quotas(BaseModel):
    """What a user may ask for; what infrastructure left incomplete is given back."""

    attempts: Quota  # evaluations in 24 hours
    scored: Quota  # of the whole suite's test split, in 30 days
    storage: Quota  # bytes of checkpoints


class Me(BaseModel):
    """Who asks."""

    name: str
    role: Role
    scopes: list[Scope]  # of what was shown; a token may have fewer than its user
    via: Literal["local", "session", "token"]
    quotas: Quotas


class TokenCreate(Given):
    """A token to be made."""

    name: Annotated[str, Field(min_length=1, max_length=80)]
    scopes: Annotated[list[Scope], Field(min_length=1)]
    expires: AwareDatetime | None = None  # null: when it is revoked


class TokenPublic(BaseModel):
    """A token without its secret."""

    id: str
    user: str
    name: str
    scopes: list[Scope]
    created: datetime
    expires: datetime | None
    last_used: datetime | None  # to within five minutes
    revoked: datetime | None


class TokenCreated(TokenPublic):
    """A new token; its text is told this once."""

    token: str


class UserCreate(Given):
    """A user to be added."""

    name: UserName
    role: Role
    password: Password | None = None  # null: tokens alone


class UserChange(Given):
    """What is to be different about a user; what is left out stays."""

    role: Role = Role.VIEWER
    password: Password = SecretStr("")
    active: StrictBool = True
    attempts: Most = None
    scored: Most = None
    storage: MostBytes = None


class UserPublic(BaseModel):
    """A user as administrators see them."""

    name: str
    role: Role
    active: bool
    has_password: bool
    created: datetime
    quotas: Quotas


class AuditEntryPublic(BaseModel):
    """Something that somebody changed, or was refused."""

    model_config = ConfigDict(from_attributes=True)

    seq: int
    time: datetime
    name: str  # of the user then, or that was given to sign in
    via: str  # local, session, token and its id, command, none
    address: str
    action: str
    subject: str
    status: int  # as HTTP
