"""Policies and their versions."""

import asyncio
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Annotated

from fastapi import Header, Query, Request, Response
from starlette.requests import ClientDisconnect

from server import checkpoints, facts, policies, quotas
from server.access import Principal, Router, Scope, needs
from server.checkpoints import Received
from server.deps import Cursor, Limit, Reading, TheHub, ThePrincipal
from server.hub import Hub
from server.problems import Problem, invalid
from server.schemas.common import Description, Page, PolicyName
from server.schemas.policies import (
    ConnectionCreate,
    ConnectionPublic,
    PolicyCreate,
    PolicyVersionPublic,
)
from workers.policies import BadPolicy, Hosted, Remote, Surroundings
from workers.preflight import Check
from workers.protocol import PythonPolicy, RemotePolicy
from workers.remote import trial

router = Router(prefix="/policies", tags=["policies"])
CHECK_LIMIT = 60.0  # s for importing and constructing a class


@router.get("")
@needs(Scope.READ)
def list_policies(
    session: Reading, limit: Limit = 50, cursor: Cursor = None
) -> Page[PolicyVersionPublic]:
    """Every version of every policy, the newest first."""
    return policies.listed(session, limit=limit, cursor=cursor)


@router.post("", status_code=201)
@needs(Scope.SUBMIT)
async def register_policy(
    wanted: PolicyCreate, hub: TheHub, principal: ThePrincipal, response: Response
) -> PolicyVersionPublic:
    """A new policy, or the next version of one. It never changes afterwards."""
    slow = isinstance(wanted.spec, PythonPolicy | RemotePolicy)  # as a connection that is tried
    async with hub.trying if slow else nullcontext():
        version = await asyncio.to_thread(_registered, wanted, hub, principal)
    response.headers["Location"] = f"/api/v1/policies/{version.id}"
    return version


def _registered(wanted: PolicyCreate, hub: Hub, principal: Principal) -> PolicyVersionPublic:
    if isinstance(wanted.spec, PythonPolicy) and not hub.settings.allow_python:
        raise Problem(
            403,
            "python_not_allowed",
            "A class of this machine runs with the server's rights; it is taken only by a server "
            "that was started with --allow-python.",
        )
    if isinstance(wanted.spec, PythonPolicy) and not principal.may(Scope.ADMIN):
        raise Problem(403, "python_not_allowed", "Only an administrator may name Python classes.")
    with hub.database.reading() as session:
        policies.require_own(session, wanted.name, principal)
    if isinstance(wanted.spec, PythonPolicy):
        _require_loads(wanted.spec, hub.surroundings(wanted.spec.timeout))
        known = wanted.spec.model_copy(update={"sha256": wanted.spec.file_hash()})
        wanted = wanted.model_copy(update={"spec": known})
    if isinstance(wanted.spec, RemotePolicy):
        found = _known_server(wanted.spec, hub.settings.allow_remote)
        wanted = wanted.model_copy(update={"spec": found})
    with hub.database.writing() as session:
        row = policies.register(
            session,
            wanted.name,
            wanted.spec,
            description=wanted.description,
            principal=principal,
            known=facts.declared(wanted.declared) if wanted.declared else None,
        )
        return policies.public(session, row)


@router.post("/connection")
@needs(Scope.SUBMIT)
async def try_connection(wanted: ConnectionCreate, hub: TheHub) -> ConnectionPublic:
    """Tries a policy's server as a worker would, and says what it answered; registers nothing.

    Refusals of the address, of the connection or of a decision are no error of the request: they
    are the last of `steps`.
    """
    allowed = tuple(hub.settings.allow_remote)
    async with hub.trying:  # a silent server takes a minute, and pages want the threads meanwhile
        found = await asyncio.to_thread(trial.tried, wanted.spec, allowed)
    return ConnectionPublic(fits=found.fits, about=found.about, steps=found.steps)


def _require_loads(spec: PythonPolicy, surroundings: Surroundings) -> None:
    """Loads the class once, in a process of its own: better now than in every episode."""
    try:
        Hosted(spec.target, surroundings).check(CHECK_LIMIT)
    except BadPolicy as error:
        raise invalid("spec.target", str(error)) from None


def _known_server(spec: RemotePolicy, allowed: Sequence[str]) -> RemotePolicy:
    """The policy with what its server says of itself; connects once, from a process of its own."""
    try:
        about = Remote.of_spec(spec, allowed).found()
    except BadPolicy as error:
        raise invalid("spec.url", str(error)) from None
    concurrency = min(spec.concurrency or about.sessions, about.sessions)
    changes = {"dialect": about.dialect, "model": about.model, "concurrency": concurrency}
    return spec.model_copy(update=changes)


RAW = {"required": True, "content": {"application/octet-stream": {"schema": {"format": "binary"}}}}


@router.post(
    "/checkpoints",
    status_code=201,
    responses={200: {"model": PolicyVersionPublic, "description": "It was there before."}},
    openapi_extra={"requestBody": RAW},
)
@needs(Scope.SUBMIT)
async def upload_checkpoint(
    name: Annotated[PolicyName, Query()],
    request: Request,
    hub: TheHub,
    principal: ThePrincipal,
    response: Response,
    description: Annotated[Description, Query()] = "",
    content_length: Annotated[int | None, Header(include_in_schema=False)] = None,
    content_type: Annotated[str, Header(include_in_schema=False)] = "",
) -> PolicyVersionPublic:
    """A checkpoint as a policy's next version; the body is the file. It is loaded once first."""
    with hub.database.reading() as session:
        policies.require_own(session, name, principal)
        quotas.require_room(session, principal, hub.settings, content_length or 0)
    checkpoints.require_torch()
    if content_type.startswith("multipart/"):
        raise Problem(415, "not_raw", "Send the file itself as the body, not a form.")
    limit = hub.settings.checkpoint_limit
    if (content_length or 0) > limit:
        raise checkpoints.too_large(limit)
    with checkpoints.receiving(hub.blobs) as path:
        try:
            pieces = request.stream()
            received = await checkpoints.receive(pieces, path, limit=limit, has_room=hub.has_room)
        except ClientDisconnect:
            raise Problem(400, "broken_off", "The checkpoint broke off.") from None
        async with hub.loading:
            version, new = await asyncio.to_thread(
                taken, hub, principal, received, name, description
            )
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/api/v1/policies/{version.id}"
    return version


def taken(
    hub: Hub, principal: Principal, received: Received, name: str, description: str
) -> tuple[PolicyVersionPublic, bool]:
    """The version that plays this file, and whether it is a new one."""
    limit = hub.settings.checkpoint_limit
    with checkpoints.as_checkpoint(hub.blobs, received, hub.surroundings(), limit) as (one, done):
        return _kept(hub, principal, one, name, description, done)


def _kept(
    hub: Hub,
    principal: Principal,
    received: Received,
    name: str,
    description: str,
    done: Sequence[Check],
) -> tuple[PolicyVersionPublic, bool]:
    header = checkpoints.header_of(received, done)
    with hub.database.reading() as session:
        if there := checkpoints.known(session, name, received.sha256):
            return policies.public(session, there), False
        quotas.require_room(session, principal, hub.settings, received.size)
    checks = checkpoints.require_fit(received, header, hub.surroundings(), done)
    hub.blobs.take(received.path, received.sha256)
    with hub.database.writing() as session:
        row = checkpoints.keep(
            session,
            received,
            name=name,
            description=description,
            config=header.config,
            suite=header.provenance.suite,
            principal=principal,
            checks=checks,
        )
        quotas.require_room(session, principal, hub.settings, 0)
        checkpoints.try_out(session, row, principal, hub.settings)
        version = policies.public(session, row)
    hub.bell.reconciler.set()
    return version, True


@router.get("/{policy}")
@needs(Scope.READ)
def get_policy(policy: str, session: Reading) -> PolicyVersionPublic:
    """One version, by id, name (the newest) or name@version."""
    try:
        return policies.public(session, policies.find(session, policy))
    except Problem as problem:
        raise Problem(404, "not_found", problem.detail) from None
