"""The reconciler over a real ledger and the real engine, whose processes do little."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
from sqlalchemy import select

from server import evaluations, jobs, lifecycle, policies
from server.bell import Bell
from server.blobs import Blobs
from server.db import Database
from server.growing import GrowingRecordings
from server.models import Attempt, Shard
from server.reconciler import Reconciler
from server.schemas.evaluations import EvaluationCreate
from tests.server import ledgers, shards
from tests.server.running import until
from workers.engines.local import LocalEngine
from workers.protocol import PythonPolicy, ShardJob


class Parts(NamedTuple):
    """A reconciler that looks when a test tells it to, and what it looks at."""

    reconciler: Reconciler
    database: Database
    engine: LocalEngine

    def look_until(self, reached: Callable[[], bool], what: str) -> None:
        def look() -> bool:
            self.reconciler.look()
            return reached()

        until(look, what, 30)

    def state(self, evaluation: str) -> str:
        with self.database.reading() as session:
            return str(evaluations.row(session, evaluation).state)

    def reasons(self) -> list[str | None]:
        with self.database.reading() as session:
            return list(session.scalars(select(Attempt.reason).order_by(Attempt.id)))


@contextmanager
def parts(
    folder: Path,
    function: Callable[[ShardJob], None],
    *,
    may_hand_out: Callable[[], bool] = lambda: True,
) -> Iterator[Parts]:
    database = ledgers.opened(folder)
    engine = LocalEngine(function, workers=1)
    draft = partial(
        jobs.draft,
        store=Blobs(folder / "blobs"),
        server="http://127.0.0.1:9",
        episode_limit=60.0,
        allow_python=False,
    )
    recordings = GrowingRecordings(folder / "growing")
    recordings.clear()
    reconciler = Reconciler(
        database,
        engine,
        recordings,
        Bell(),
        slots=lambda: 1,
        draft=draft,
        may_hand_out=may_hand_out,
    )
    try:
        yield Parts(reconciler, database, engine)
    finally:
        engine.close()
        database.close()


def created(database: Database, policy: str = "expert", **wanted: object) -> str:
    with database.writing() as session:
        return ledgers.created(session, policy, **{"tasks": ["reopen_drawer"], **wanted}).id


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (shards.returns, "ended with 2 episodes left to play"),
        (shards.raises, "RuntimeError: no simulator for reopen_drawer"),
    ],
)
def test_three_attempts_that_come_to_nothing_fail_a_shard(
    tmp_path: Path, function: Callable[[ShardJob], None], reason: str
) -> None:
    with parts(tmp_path, function) as these:
        evaluation = created(these.database, episodes=2)

        these.look_until(lambda: these.state(evaluation) == "incomplete", "the end")

        assert these.reasons() == [reason] * lifecycle.FAULTS
        with these.database.reading() as session:
            assert reason in str(evaluations.get(session, evaluation).reason)


def test_an_attempt_that_the_engine_does_not_know_is_lost(tmp_path: Path) -> None:
    with parts(tmp_path, shards.hangs, may_hand_out=lambda: False) as these:
        created(these.database, episodes=1)
        with these.database.writing() as session:
            assert ledgers.leased(session)

        these.reconciler.look()

        assert these.reasons() == ["its worker disappeared"]
        with these.database.reading() as session:
            assert session.scalar(select(Shard.state)) == "pending"


def test_a_cancelled_attempt_is_stopped(tmp_path: Path) -> None:
    with parts(tmp_path, shards.hangs) as these:
        evaluation = created(these.database, episodes=1)
        these.reconciler.look()
        assert len(these.engine.inventory()) == 1
        with these.database.writing() as session:
            lifecycle.cancel(session, evaluations.row(session, evaluation))

        these.look_until(lambda: these.state(evaluation) == "cancelled", "the end")

        assert these.engine.inventory() == set()


def test_no_more_is_handed_out_than_is_run_and_kept_at_hand(tmp_path: Path) -> None:
    with parts(tmp_path, shards.hangs) as these:
        created(these.database, episodes=25)

        these.reconciler.look()
        these.reconciler.look()

        assert len(these.engine.inventory()) == 2


def test_nothing_is_handed_out_while_the_disk_is_full(tmp_path: Path) -> None:
    with parts(tmp_path, shards.hangs, may_hand_out=lambda: False) as these:
        evaluation = created(these.database)

        these.reconciler.look()

        assert these.engine.inventory() == set()
        assert these.state(evaluation) == "queued"


def test_what_cannot_be_played_fails_and_does_not_hold_up_the_rest(tmp_path: Path) -> None:
    with parts(tmp_path, shards.hangs) as these:
        ledgers.registered(these.database, "mine")
        mine = created(these.database, "mine", episodes=10, priority=5)
        created(these.database, episodes=1)

        these.reconciler.look()

        assert these.state(mine) == "incomplete"
        with these.database.reading() as session:
            assert "--allow-python" in str(evaluations.get(session, mine).reason)
        assert len(these.engine.inventory()) == 1


def test_a_class_that_changed_since_it_was_registered_is_not_played(tmp_path: Path) -> None:
    file = tmp_path / "policy.py"
    file.write_text("class Mine: ...")
    spec = PythonPolicy(target=f"{file}:Mine")
    known = spec.model_copy(update={"sha256": spec.file_hash()})
    with parts(tmp_path, shards.hangs) as these, these.database.writing() as session:
        evaluation = evaluations.create(
            session,
            EvaluationCreate(policy=policies.register(session, "mine", known).id, episodes=1),
        )
        session.flush()
        [shard, *_] = session.scalars(select(Shard).where(Shard.evaluation_id == evaluation.id))
        store = Blobs(tmp_path / "blobs")
        draft = partial(jobs.draft, session, shard, store=store, server="", episode_limit=1.0)

        assert draft(allow_python=True).sources == evaluation.sources[shard.task]
        file.write_text("class Mine: pass")

        with pytest.raises(jobs.CannotPlay, match="register it again"):
            draft(allow_python=True)
