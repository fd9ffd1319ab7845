"""Policies, their versions, and checkpoints on their way in."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import BaseModel, Field, StrictBool

from server.schemas.common import Component, Description, Given, PolicyName
from workers.preflight import Check
from workers.protocol import NamedPolicy, PolicySpec, RemotePolicy
from workers.remote.target import About
from workers.remote.trial import Step


class PolicyDeclared(Given):
    """What whoever registers a policy says of its memory; nobody checks it."""

    memory: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.:+-]{0,39}$")] | None = None
    clock: StrictBool | None = None  # it is told the number of the decision
    privileged: StrictBool | None = None  # it knows more than the cameras show


class PolicyCreate(Given):
    """A policy to be registered; the same name again makes its next version."""

    name: PolicyName
    description: Description = ""
    spec: NamedPolicy  # a checkpoint is uploaded
    declared: PolicyDeclared | None = None


class PolicyFacts(BaseModel):
    """What is known of a policy's memory; null where nothing is."""

    source: Literal["built-in", "checkpoint", "declared", "unknown"]
    memory: str  # what it remembers with: "SCM+WCM+PAM", "none", as declared, or "undeclared"
    components: list[Component] = []  # of SEEK's memory
    window: int | None = None  # entries of WCM
    content: Literal["visual", "proprioception"] | None = None  # what the entries hold
    clock: bool | None = None  # it is told the number of the decision
    privileged: bool | None = None  # it knows more than the cameras show
    preset: str = ""  # the name of a checkpoint's configuration


class ConnectionCreate(Given):
    """A policy's server to be tried; nothing is registered."""

    spec: RemotePolicy


class ConnectionPublic(BaseModel):
    """What a policy's server answered."""

    fits: bool  # it can be registered; a decision that failed does not hinder that
    about: About | None  # null: it was not reached
    steps: list[Step]  # what was tried, in order; the last may have failed


class PolicyVersionPublic(BaseModel):
    """One version of a policy; it never changes."""

    id: str
    policy: str  # its name
    version: int
    description: str
    spec: PolicySpec
    reference: bool  # a built-in policy, shown beside the ranking
    created: datetime
    owner: str | None  # name of a user; null: the server's own
    checks: list[Check]  # what was tried of it when it came
    facts: PolicyFacts
    smoke: str | None  # the evaluation that tried it then, of one episode a category


class UploadMetadata(Given):
    """What a client says of an upload when it begins."""

    name: PolicyName
    description: Description = ""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    # what tus clients add of themselves
    filename: Annotated[str, Field(max_length=500), Field(exclude=True)] = ""
    filetype: Annotated[str, Field(max_length=500), Field(exclude=True)] = ""


class UploadPublic(BaseModel):
    """How far an upload is."""

    id: str
    name: str  # of the policy
    sha256: str | None  # that the client says the file has
    offset: int  # bytes that have come
    length: int
    expires: datetime
