"""Checkpoints uploaded by the tus protocol 1.0 (https://tus.io): cut off, they go on.

creation (Upload-Metadata: name, description, sha256) ─► PATCH at the offset, as often as it takes
─► POST …/version loads what came and makes it a policy's version.
"""

import asyncio
import base64
import binascii
import re
from collections.abc import Mapping
from email.utils import format_datetime
from typing import Annotated

from fastapi import Depends, Header, Request, Response
from pydantic import TypeAdapter, ValidationError
from starlette.requests import ClientDisconnect

from server import checkpoints, policies, quotas, uploads
from server.access import Gate, Principal, Router, Scope, needs
from server.deps import Reading, TheHub, ThePrincipal
from server.hub import Hub
from server.models import Upload, now
from server.problems import Problem, invalid, of_validation
from server.routes.policies import taken
from server.schemas.policies import PolicyVersionPublic, UploadMetadata, UploadPublic

router = Router(prefix="/uploads", tags=["uploads"])
VERSION = "1.0.0"
EXTENSIONS = "creation,expiration,checksum,termination"
BYTES = "application/offset+octet-stream"
CHECKSUM = re.compile(r"sha256 ([A-Za-z0-9+/]{43}=)")
BLANK = {"Tus-Resumable": VERSION, "Cache-Control": "no-store"}
BODY = {"requestBody": {"required": True, "content": {BYTES: {"schema": {"format": "binary"}}}}}


def _speaks_tus(tus_resumable: Annotated[str, Header()] = "") -> None:
    if tus_resumable != VERSION:
        raise Problem(
            412,
            "tus_version",
            f"Tus-Resumable: {VERSION} is wanted.",
            headers={"Tus-Version": VERSION},
        )


SpeaksTus = Depends(_speaks_tus)


@router.options("", status_code=204)
@needs(Gate.PUBLIC)
def describe_uploads(hub: TheHub) -> Response:
    """What of the protocol is spoken here."""
    headers = {
        "Tus-Resumable": VERSION,
        "Tus-Version": VERSION,
        "Tus-Extension": EXTENSIONS,
        "Tus-Max-Size": str(hub.settings.checkpoint_limit),
        "Tus-Checksum-Algorithm": "sha256",
    }
    return Response(status_code=204, headers=headers)


@router.post("", status_code=201, dependencies=[SpeaksTus])
@needs(Scope.SUBMIT)
def create_upload(
    hub: TheHub,
    principal: ThePrincipal,
    upload_length: Annotated[int, Header(ge=1, lt=2**63)],
    upload_metadata: Annotated[str, Header(max_length=8000)],
) -> Response:
    """A new upload; a file that one has uploaded before, by its sha256, has come already."""
    limit = hub.settings.checkpoint_limit
    if upload_length > limit:
        raise checkpoints.too_large(limit)
    what = _metadata(upload_metadata)
    if not hub.has_room(upload_length):
        raise Problem(507, "no_room", checkpoints.NO_ROOM)
    with hub.database.writing() as session:
        policies.require_own(session, what.name, principal)
        hub.uploads.sweep(session)
        row = uploads.create(
            session, principal.user, length=upload_length, **what.model_dump(mode="json")
        )
        quotas.require_room(
            session, principal, hub.settings, uploads.reserved(session, principal.user)
        )
        known = what.sha256 and quotas.owns(session, principal.user, what.sha256)
    if known and what.sha256 and hub.blobs.path(what.sha256).stat().st_size == upload_length:
        hub.uploads.of(row.id).copy(hub.blobs.path(what.sha256))
    headers = {"Location": f"/api/v1/uploads/{row.id}", **_headers(hub, row)}
    return Response(status_code=201, headers=headers)


@router.get("")
@needs(Scope.SUBMIT)
def list_uploads(session: Reading, hub: TheHub, principal: ThePrincipal) -> list[UploadPublic]:
    """One's own uploads that are not done, so that another process can go on with one."""
    return [_public(hub, row) for row in uploads.of_user(session, principal.user)]


@router.get("/{upload}", dependencies=[SpeaksTus])
@needs(Scope.SUBMIT)
def get_upload(
    upload: str, hub: TheHub, principal: ThePrincipal, response: Response
) -> UploadPublic:
    """How much has come; HEAD tells it in headers alone."""
    row = _row(hub, upload, principal)
    response.headers.update(_headers(hub, row))
    return _public(hub, row)


def _public(hub: Hub, row: Upload) -> UploadPublic:
    return UploadPublic(
        id=row.id,
        name=row.name,
        sha256=row.sha256,
        offset=hub.uploads.of(row.id).size,
        length=row.length,
        expires=row.expires,
    )


@router.patch("/{upload}", status_code=204, dependencies=[SpeaksTus], openapi_extra=BODY)
@needs(Scope.SUBMIT)
async def add_to_upload(
    upload: str,
    request: Request,
    hub: TheHub,
    principal: ThePrincipal,
    upload_offset: Annotated[int, Header(ge=0, lt=2**63)],
    upload_checksum: Annotated[str | None, Header(max_length=200)] = None,
    content_type: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """More of the file, from the offset on; what a broken connection left is kept."""
    if content_type != BYTES:
        raise Problem(415, "not_raw", f"Content-Type: {BYTES} is wanted.")
    checksum = _checksum(upload_checksum)
    row = await asyncio.to_thread(_row, hub, upload, principal)
    coming = hub.uploads.of(row.id)
    if coming.busy.locked():
        raise Problem(423, "busy", "Another request is adding to this upload.")
    async with coming.busy:
        if upload_offset != coming.size:
            raise Problem(
                409, "wrong_offset", f"The upload is at {coming.size}, not {upload_offset}."
            )
        try:
            await coming.add(
                request.stream(), most=row.length, has_room=hub.has_room, checksum=checksum
            )
        except ClientDisconnect:
            raise Problem(400, "broken_off", "The connection broke; what came is kept.") from None
    row = await asyncio.to_thread(_prolonged, hub, upload, principal)
    return Response(status_code=204, headers=_headers(hub, row))


@router.delete("/{upload}", status_code=204, dependencies=[SpeaksTus])
@needs(Scope.SUBMIT)
def end_upload(upload: str, hub: TheHub, principal: ThePrincipal) -> Response:
    """Forgets an upload and what has come of it."""
    with hub.database.writing() as session:
        session.delete(uploads.find(session, upload, principal.user))
    hub.uploads.remove(upload)
    return Response(status_code=204, headers={"Tus-Resumable": VERSION})


@router.post(
    "/{upload}/version",
    status_code=201,
    responses={200: {"model": PolicyVersionPublic, "description": "It was there before."}},
)
@needs(Scope.SUBMIT)
async def make_version(
    upload: str, hub: TheHub, principal: ThePrincipal, response: Response
) -> PolicyVersionPublic:
    """Loads what has come, once, and makes it the policy's next version; the upload ends."""
    checkpoints.require_torch()
    row = await asyncio.to_thread(_row, hub, upload, principal)
    coming = hub.uploads.of(row.id)
    if coming.busy.locked():
        raise Problem(423, "busy", "Another request is adding to this upload.")
    async with coming.busy, hub.loading:
        received = await asyncio.to_thread(coming.received)
        if received.size != row.length:
            raise Problem(409, "not_whole", f"{received.size} of {row.length} bytes have come.")
        if row.sha256 not in (None, received.sha256):
            raise invalid("sha256", f"is {row.sha256}; what came has {received.sha256}")
        version, new = await asyncio.to_thread(
            taken, hub, principal, received, row.name, row.description
        )
    await asyncio.to_thread(end_upload, upload, hub, principal)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/api/v1/policies/{version.id}"
    return version


def _row(hub: Hub, upload: str, principal: Principal) -> Upload:
    with hub.database.reading() as session:
        return uploads.find(session, upload, principal.user)


def _prolonged(hub: Hub, upload: str, principal: Principal) -> Upload:
    with hub.database.writing() as session:
        row = uploads.find(session, upload, principal.user)
        row.expires = now() + uploads.STAYS
        return row


def _headers(hub: Hub, row: Upload) -> Mapping[str, str]:
    return BLANK | {
        "Upload-Offset": str(hub.uploads.of(row.id).size),
        "Upload-Length": str(row.length),
        "Upload-Expires": format_datetime(row.expires, usegmt=True),
    }


def _metadata(text: str) -> UploadMetadata:
    """What Upload-Metadata says: names, each with a value in base64."""
    found = {}
    for pair in text.split(","):
        name, _, value = pair.strip().partition(" ")
        try:
            found[name] = base64.b64decode(value, validate=True).decode()
        except (binascii.Error, UnicodeDecodeError):
            raise invalid("upload-metadata", f"{name[:40]} is not base64 of UTF-8") from None
    try:
        return TypeAdapter(UploadMetadata).validate_python(found)
    except ValidationError as error:
        raise of_validation(error.errors()) from None


def _checksum(text: str | None) -> bytes | None:
    if text is None:
        return None
    if not (found := CHECKSUM.fullmatch(text)):
        raise Problem(400, "checksum", "Upload-Checksum is 'sha256' and the digest in base64.")
    return base64.b64decode(found[1])
