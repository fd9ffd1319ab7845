"""Ledgers for tests: real databases, filled by the server's own functions, without a simulator."""

import base64
import hashlib
import io
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import suite
from hide_tasks.contract import (
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    Failure,
    Keyframe,
    MotionOutcome,
    Split,
    Start,
    Timing,
)
from seek_model.presets import preset
from server import checkpoints, evaluations, lifecycle, policies
from server.blobs import Blobs
from server.checkpoints import Received
from server.commit import commit
from server.db import Database
from server.models import Attempt, Episode, Evaluation, Shard
from server.schemas.evaluations import EvaluationCreate
from server.settings import LEDGER
from workers.preflight import Check
from workers.protocol import (
    EpisodeCommit,
    HiddenChange,
    PythonPolicy,
    measured_digest,
)

Outcome = Failure | None  # of an episode; None: exact
Outcomes = Callable[[EpisodeSpec], Outcome]


KINDS = ("sqlite", "postgresql")
kind = "sqlite"  # of the ledgers that are opened; tests/server/conftest.py changes it


def opened(folder: Path, in_what: str = "") -> Database:
    """A new ledger with the built-in policies, or the one that is there."""
    sqlite = (in_what or kind) == "sqlite"
    return Database(laid(folder) if sqlite else laid_in_postgres(folder))


def laid_in_postgres(folder: Path) -> str:
    """The address of a database for this folder, which is a new ledger unless it is there."""
    from tests.server import postgres

    name = f"of_{hashlib.sha256(str(folder).encode()).hexdigest()[:32]}"
    if postgres.exists(name):
        return postgres.address(name)
    return postgres.create(name, template=_new_postgres_ledger())


@cache
def _new_postgres_ledger() -> str:
    from tests.server import postgres

    database = Database(postgres.create("new_ledger"))
    with database.writing() as session:
        policies.register_builtin(session)
    database.close()
    return "new_ledger"


def laid(folder: Path) -> Path:
    """The file of a new ledger, closed; one that is there stays."""
    path = folder / LEDGER
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_new_ledger())
    return path


@cache
def _new_ledger() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / LEDGER
        database = Database(path)
        with database.writing() as session:
            policies.register_builtin(session)
        database.close()
        return path.read_bytes()


def registered(database: Database, name: str) -> str:
    """A policy of somebody's; its version's id."""
    spec = PythonPolicy(target="tests.workers.some_policies:Stays")
    with database.writing() as session:
        return policies.register(session, name, spec).id


def uploaded(
    database: Database,
    store: Blobs,
    name: str,
    content: bytes,
    checks: Sequence[Check] = (),
    model: str = "seek-small",
) -> str:
    """A policy of somebody's that is a checkpoint, of which nothing is looked at; its id."""
    received, config = Received(Path(), store.put(content), len(content)), preset(model)
    with database.writing() as session:
        kept = checkpoints.keep(
            session, received, name=name, description="", config=config, checks=checks
        )
        return kept.id


def created(session: Session, policy: str = "expert", **wanted: Any) -> Evaluation:
    """A queued evaluation."""
    return evaluations.create(session, EvaluationCreate(policy=policy, **wanted))


def leased(session: Session) -> tuple[Attempt, Shard] | None:
    """The next attempt, if a shard waits."""
    shard = lifecycle.next_shard(session)
    if shard is None:
        return None
    return lifecycle.lease(session, shard, engine="local")[0], shard


def result_of(spec: EpisodeSpec, failure: Outcome = None, **changes: Any) -> EpisodeCommit:
    """What a worker would send of an episode with three decisions; the second one stays still."""
    hidden = [{"presses_done": n, "item_in": "top"} for n in range(4)]
    exact = failure is None
    success = exact or failure in (Failure.OVERCOUNT, Failure.REPEATED_STEP)
    decisions = tuple(
        DecisionRecord(
            decision=n,
            time=1.5 * (n + 1),
            action=Keyframe(position=(0.3, 0.0, 0.9 + n / 100), quaternion=(0, 1, 0, 0)),
            outcome=MotionOutcome.NO_PATH if n == 1 else MotionOutcome.ARRIVED,
            path="" if n == 1 else "straight",
            stage=f"press {n + 1}",
            hidden=hidden[n + 1],
            checks={"pressed_exactly": exact and n == 2, "arm_withdrawn": n == 2},
            success=success and n == 2,
            violations=[failure] if failure and n == 2 else [],
        )
        for n in range(3)
    )
    start = Start(stage="press 1", hidden=hidden[0], checks={"pressed_exactly": False})
    seen = tuple(
        HiddenChange(time=1.5 * n, decision=n, stage=f"press {max(n, 1)}", hidden=hidden[n])
        for n in range(4)
    )
    result = EpisodeResult(
        **spec.model_dump(include={"task", "split", "index", "variation"}),
        instruction=f"do {spec.task}",
        success=success,
        exact=exact,
        failure=failure,
        decisions=3,
        stage="press 3",
        scene_hash=_scene_hash(spec.task, spec.split, spec.index),
        final_state_hash="f" * 64,
        timing=Timing(total=0.5, steps=1080, renders=4),
    ).model_copy(update=changes)
    return EpisodeCommit(
        result=result,
        start=start,
        decisions=decisions,
        changes=seen,
        thumbnail=base64.b64encode(picture(exact)),
        digest=measured_digest(result, start, decisions, seen),
    )


@cache
def _scene_hash(task: str, split: Split, index: int) -> str:
    return suite.scene_hash(suite.episode(task, split, index))


@cache
def picture(exact: bool) -> bytes:
    """A JPEG, green or red."""
    file = io.BytesIO()
    Image.new("RGB", (128, 128), (88, 140, 120) if exact else (190, 90, 80)).save(file, "JPEG")
    return file.getvalue()


def play_shard(session: Session, store: Blobs, outcomes: Outcomes = lambda _: None) -> bool:
    """Leases the next shard, commits its episodes, and ends it; False if none waits."""
    found = leased(session)
    if found is None:
        return False
    attempt, shard = found
    for episode in lifecycle.open_episodes(shard):
        lifecycle.begin(session, attempt, episode)
        spec = lifecycle.spec_of(episode)
        commit(session, store, attempt, episode, result_of(spec, outcomes(spec)))
    session.flush()
    lifecycle.end_attempt(session, attempt, None)
    return True


def evaluated(
    database: Database,
    store: Blobs,
    policy: str = "expert",
    outcomes: Outcomes = lambda _: None,
    **wanted: Any,
) -> str:
    """A completed evaluation's id; nothing else may wait in the ledger."""
    with database.writing() as session:
        id = created(session, policy, **wanted).id
        while play_shard(session, store, outcomes):
            pass
        return id


def episodes_of(session: Session, evaluation: str) -> list[Episode]:
    """An evaluation's episodes, by task and index."""
    found = select(Episode).where(Episode.evaluation_id == evaluation)
    return list(session.scalars(found.order_by(Episode.task, Episode.index)))
