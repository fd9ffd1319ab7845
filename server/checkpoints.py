"""Checkpoints on their way in: received, looked at, tried once, kept, and made a policy's version.

Only the policy process of the one loading sees torch; here the file's header is read, no more.
"""

import asyncio
import errno
import hashlib
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Literal, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import SUITES
from hide_tasks.catalogue import cameras_of
from hide_tasks.suite import SUITE
from seek_model.checkpoint_header import BadCheckpoint, Header, read_header
from seek_model.config import Config
from seek_model.other_formats import is_saved
from server import blobs, evaluations, facts, policies, quotas, smoke
from server.access import Principal
from server.blobs import Blobs
from server.models import Evaluation, Policy, PolicyVersion
from server.problems import Problem, invalid
from server.schemas.evaluations import EvaluationCreate
from server.settings import Settings
from server.suites import SMOKE_SPLIT, smoke_tasks
from workers.conversion import convert
from workers.policies import (
    MISMATCH,
    NO_TORCH,
    BadPolicy,
    Checkpoint,
    Surroundings,
    has_torch,
)
from workers.preflight import Check, NotFit, preflight
from workers.protocol import CheckpointPolicy

CHECK_LIMIT = 300.0  # s for importing torch, building the network and reading its weights
STILL_LIMIT = 60.0  # s without a byte, after which an upload is given up
FAULTS = {
    "conversion": "is no checkpoint",
    "header": "is no checkpoint",
    "load": "cannot be loaded",
}
NO_ROOM = "The server's disk is almost full; nothing was kept."


class Received(NamedTuple):
    """A file that came in whole; it is gone when its `receiving` ends, unless it was taken."""

    path: Path
    sha256: str
    size: int  # bytes


@contextmanager
def receiving(store: Blobs) -> Iterator[Path]:
    """A path for an upload; nothing is left there afterwards, a server's death included."""
    part = store.new_part()
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


async def receive(
    pieces: AsyncIterator[bytes], path: Path, *, limit: int, has_room: Callable[[], bool]
) -> Received:
    """Writes what comes to a file.

    Args:
        limit: bytes that a checkpoint may have.
        has_room: asked while it grows.

    Raises:
        Problem: 408, it stood still; 413, it is too large; 422, nothing came; 507, no room.
        ClientDisconnect: it broke off.
    """
    digest, size = hashlib.sha256(), 0
    now = asyncio.get_running_loop().time
    try:
        async with asyncio.timeout(STILL_LIMIT) as still:
            with path.open("xb") as file:
                async for piece in pieces:
                    still.reschedule(now() + STILL_LIMIT)
                    size += len(piece)
                    if size > limit:
                        raise too_large(limit)
                    if not has_room():
                        raise Problem(507, "no_room", NO_ROOM)
                    file.write(piece)
                    digest.update(piece)
    except TimeoutError:
        message = f"No byte came for {STILL_LIMIT:g} s; the upload was given up."
        raise Problem(408, "too_slow", message) from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise Problem(507, "no_room", NO_ROOM) from None
    if not size:
        raise invalid("body", "is empty; send the checkpoint's bytes as they are")
    return Received(path, digest.hexdigest(), size)


def too_large(limit: int) -> Problem:
    """A checkpoint is larger than the server takes."""
    message = f"A checkpoint has at most {limit} bytes here; HIDE_SERVER_CHECKPOINT_LIMIT says so."
    return Problem(413, "too_large", message)


def require_torch() -> None:
    """Does nothing if checkpoints can be played here.

    Raises:
        Problem: 503, they cannot; it tells what to install.
    """
    if not has_torch():
        raise Problem(503, "no_torch", f"{NO_TORCH}, then start the server again.")


def header_of(received: Received, done: Sequence[Check] = ()) -> Header:
    """What the file says of itself.

    Args:
        done: what was tried of it before.

    Raises:
        Problem: 422, it is no checkpoint, and what the first mismatch is; `checks` has every step.
    """
    try:
        return read_header(received.path)
    except BadCheckpoint as error:
        failed = Check(name="header", outcome="failed", seconds=0.0, detail=str(error))
        raise _unfit([*done, failed]) from None


@contextmanager
def as_checkpoint(
    store: Blobs, received: Received, surroundings: Surroundings, limit: int
) -> Iterator[tuple[Received, list[Check]]]:
    """The checkpoint in what came in, converted if it is a file of torch.save.

    Raises:
        Problem: 422, it holds none, and why.
    """
    if not is_saved(received.path):
        yield received, []
        return
    with receiving(store) as part:
        begun = monotonic()
        try:
            convert(received.path, part, surroundings, most=limit, limit=CHECK_LIMIT)
        except BadPolicy as error:
            raise _unfit([_conversion("failed", begun, str(error))]) from None
        done = _conversion("passed", begun, f"a file of torch.save, SHA-256 {received.sha256}")
        with part.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        yield Received(part, sha256, part.stat().st_size), [done]


def _conversion(outcome: Literal["passed", "failed"], begun: float, detail: str) -> Check:
    seconds = round(monotonic() - begun, 3)
    return Check(name="conversion", outcome=outcome, seconds=seconds, detail=detail)


def require_fit(
    received: Received, header: Header, surroundings: Surroundings, done: Sequence[Check] = ()
) -> list[Check]:
    """Tries it once, in a process of its own: better now than in every episode.

    Args:
        done: what was tried of it before; it is in what comes back.

    Raises:
        Problem: 422, it cannot be loaded or does not act, and why; `checks` tells every step.
    """
    told = f"{header.config.name}, {len(header.tensors)} tensors, {header.parameters:,} numbers"
    looked = Check(name="header", outcome="passed", seconds=0.0, detail=told)
    policy = Checkpoint.of_file(received.path, received.sha256, surroundings).make()
    try:
        cameras = cameras_of(header.provenance.suite)
        return [*done, looked, *preflight(policy, CHECK_LIMIT, cameras)]
    except NotFit as error:
        raise _unfit([*done, looked, *error.checks]) from None


def _unfit(checks: Sequence[Check]) -> Problem:
    failed = checks[-1]
    what = FAULTS.get(failed.name, "does not act")
    message = f"{what}: {failed.detail.removeprefix(MISMATCH)}"
    fault = {"field": "body", "message": message}
    said = [check.model_dump(mode="json") for check in checks]
    return Problem(422, "invalid", f"body: {message}", [fault], members={"checks": said})


def known(session: Session, name: str, sha256: str) -> PolicyVersion | None:
    """The version of this policy that plays this file, if there is one."""
    found = (
        select(PolicyVersion)
        .join(Policy)
        .where(Policy.name == name, PolicyVersion.spec["sha256"].as_string() == sha256)
        .order_by(PolicyVersion.number.desc())
    )
    return next((one for one in session.scalars(found) if one.spec["kind"] == "checkpoint"), None)


def keep(
    session: Session,
    received: Received,
    *,
    name: str,
    description: str,
    config: Config,
    suite: str = SUITE,
    principal: Principal | None = None,
    checks: Sequence[Check] = (),
) -> PolicyVersion:
    """The next version of a policy, whose file is in its place.

    Raises:
        Problem: 422, the name is the server's own; 403, it is somebody else's.
    """
    blobs.note(session, received.sha256, received.size, blobs.CHECKPOINT)
    spec = CheckpointPolicy(
        sha256=received.sha256, size=received.size, model=config.name, suite=suite
    )
    return policies.register(
        session,
        name,
        spec,
        description=description,
        principal=principal,
        checks=checks,
        known=facts.of_config(config),
    )


def try_out(
    session: Session, version: PolicyVersion, principal: Principal, settings: Settings
) -> Evaluation | None:
    """The evaluation of suite `smoke` that tries a new version; it counts as its owner's.

    None if this server begins none, or if the quota of whoever uploads is used up.
    """
    if not settings.smoke:
        return None
    wanted, owner = _first_try(version), version.policy.owner_id
    try:
        with session.begin_nested():
            row = evaluations.create(session, wanted, smoke.key(version), owner=owner)
            session.flush()
            quotas.require_evaluation(session, principal, settings)
    except Problem as problem:
        if problem.status != 429:
            raise
        return None
    return row


def _first_try(version: PolicyVersion) -> EvaluationCreate:
    """What suite `smoke` is, or as little of another suite that a version was trained on."""
    suite = version.spec.get("suite", SUITE)
    if suite == SUITE or not SUITES.get(suite):
        return EvaluationCreate(policy=version.id, suite="smoke")
    tasks = list(smoke_tasks(suite))
    return EvaluationCreate(policy=version.id, tasks=tasks, split=SMOKE_SPLIT, episodes=1)
