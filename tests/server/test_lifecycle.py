"""The life of an evaluation in the ledger: planned, handed out, lost, tried again, ended."""

import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import SUITES
from server import lifecycle
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.evaluations import current_sources
from server.lifecycle import FAULTS, end_attempt
from server.models import Attempt, Episode, Evaluation, Event, Shard
from server.problems import Problem
from tests.server import ledgers
from workers.protocol import SHARD_SIZE

pytestmark = pytest.mark.usefixtures("on_each_database")
TASK = "search_drawer"


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def store(tmp_path: Path) -> Blobs:
    return Blobs(tmp_path / "blobs")


def lease(session: Session) -> tuple[Attempt, Shard]:
    found = ledgers.leased(session)
    assert found is not None, "no shard waits"
    return found


def play(session: Session, store: Blobs, attempt: Attempt, episode: Episode) -> None:
    lifecycle.begin(session, attempt, episode)
    result = ledgers.result_of(lifecycle.spec_of(episode))
    assert not isinstance(commit(session, store, attempt, episode, result), Problem)


def lose_all(session: Session) -> None:
    """Every attempt is lost, until none is left."""
    while found := ledgers.leased(session):
        end_attempt(session, found[0], "it crashed")


def shards(session: Session, evaluation: Evaluation) -> list[Shard]:
    found = select(Shard).where(Shard.evaluation_id == evaluation.id)
    return list(session.scalars(found.order_by(Shard.task, Shard.first_index)))


def told(session: Session, evaluation: Evaluation, kind: str = "evaluation") -> list[str]:
    """The states that followers were told."""
    session.flush()
    events = select(Event).where(Event.evaluation_id == evaluation.id, Event.kind == kind)
    return [event.payload["state"] for event in session.scalars(events.order_by(Event.seq))]


# --- create ---


@pytest.mark.parametrize("episodes", [1, 5, 6, 25])
def test_every_episode_is_planned_once_in_shards_of_at_most_five(
    database: Database, episodes: int
) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, episodes=episodes)
        planned = shards(session, evaluation)
        found = [(one.task, one.index) for shard in planned for one in shard.episodes]

    assert sorted(found) == [(task, n) for task in sorted(SUITES["hide"]) for n in range(episodes)]
    assert all(1 <= len(shard.episodes) <= SHARD_SIZE for shard in planned)
    assert all({one.task for one in shard.episodes} == {shard.task} for shard in planned)
    assert evaluation.sources == {task: current_sources()[task] for task in SUITES["hide"]}


def test_a_queued_evaluation_waits_untouched(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, episodes=1)

        assert (evaluation.state, evaluation.desired) == ("queued", "finished")
        assert evaluation.started is evaluation.ended is None
        assert told(session, evaluation) == ["queued"]


# --- lease ---


def test_higher_priority_goes_first(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=5)
        urgent = ledgers.created(session, tasks=[TASK], episodes=5, priority=1)

        assert lease(session)[1].evaluation is urgent


def test_evaluations_of_one_priority_share_fairly(database: Database) -> None:
    with database.writing() as session:
        for _ in range(3):
            ledgers.created(session, tasks=[TASK], episodes=25)
        held = Counter(lease(session)[1].evaluation_id for _ in range(9))

    assert list(held.values()) == [3, 3, 3]


def test_the_oldest_goes_first_among_equals(database: Database) -> None:
    with database.writing() as session:
        ids = [ledgers.created(session, tasks=[TASK], episodes=1).id for _ in range(3)]

        assert [lease(session)[1].evaluation_id for _ in ids] == ids


def test_the_tasks_of_an_evaluation_go_side_by_side(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, episodes=10)
        leased = [lease(session) for _ in range(2 * len(SUITES["hide"]))]
        order = [(shard.first_index, shard.task) for _, shard in leased]

    assert order == [(first, task) for first in (0, 5) for task in sorted(SUITES["hide"])]


def test_the_first_lease_starts_the_evaluation(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, episodes=1)
        attempt, shard = lease(session)

        assert (evaluation.state, shard.state, attempt.state) == ("running", "leased", "open")
        assert evaluation.started is not None
        assert told(session, evaluation) == ["queued", "running"]


def test_a_leased_shard_is_not_handed_out_again(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=5)
        lease(session)

        assert lifecycle.next_shard(session) is None


def test_fences_grow_with_every_attempt(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=1)
        fences = []
        for _ in range(FAULTS):
            attempt, _ = lease(session)
            fences.append(attempt.fence)
            end_attempt(session, attempt, "it crashed")

    assert fences == [1, 2, 3]


def test_a_token_is_kept_nowhere(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=1)
        shard = lifecycle.next_shard(session)
        assert shard is not None
        attempt, token = lifecycle.lease(session, shard, engine="local")

        assert attempt.token_hash == lifecycle.hash_token(token)
        columns = session.execute(select(*Attempt.__table__.columns)).one()
    assert token not in map(str, columns)
    if database.engine.dialect.name == "sqlite":
        assert token.encode() not in database.path.read_bytes()


def test_each_shard_is_leased_once_however_many_ask(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK, "reopen_drawer"], episodes=25)
    leased: list[str] = []

    def ask() -> None:
        while True:
            with database.writing() as session:
                if (found := ledgers.leased(session)) is None:
                    return
                leased.append(found[1].id)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(leased) == len(set(leased)) == 10


# --- end ---


def test_the_last_final_episode_completes_the_evaluation(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=7)
        assert ledgers.play_shard(session, store)
        assert evaluation.state == "running"
        assert ledgers.play_shard(session, store)

        assert evaluation.state == "completed"
        assert evaluation.ended is not None and evaluation.reason is None
        assert {shard.state for shard in shards(session, evaluation)} == {"done"}
        assert told(session, evaluation) == ["queued", "running", "completed"]
        assert told(session, evaluation, "attempt") == ["done", "done"]


def test_a_lost_attempt_goes_back_to_the_queue(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=3)
        attempt, shard = lease(session)
        play(session, store, attempt, shard.episodes[0])
        lifecycle.begin(session, attempt, shard.episodes[1])
        end_attempt(session, attempt, "killed by SIGKILL")

        assert (attempt.state, attempt.reason) == ("lost", "killed by SIGKILL")
        assert (shard.state, shard.faults) == ("pending", 1)
        assert [one.state for one in shard.episodes] == ["final", "pending", "pending"]
        assert evaluation.state == "running"


def test_the_next_attempt_plays_only_what_is_left(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=3)
        attempt, shard = lease(session)
        play(session, store, attempt, shard.episodes[1])
        end_attempt(session, attempt, "it crashed")
        lease(session)

        assert [one.index for one in lifecycle.open_episodes(shard)] == [0, 2]


def test_an_attempt_that_returns_with_episodes_left_is_lost(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=2)
        attempt, shard = lease(session)
        end_attempt(session, attempt, None)

        assert attempt.reason == shard.reason == "ended with 2 episodes left to play"
        assert shard.faults == 1


def test_ending_an_attempt_twice_does_nothing(database: Database) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=1)
        attempt, shard = lease(session)
        end_attempt(session, attempt, "it crashed")
        end_attempt(session, attempt, "it crashed again")

        assert (attempt.reason, shard.faults) == ("it crashed", 1)


def test_three_faults_of_a_shard_make_the_evaluation_incomplete(
    database: Database, store: Blobs
) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        assert ledgers.play_shard(session, store)
        for _ in range(FAULTS):
            assert evaluation.state == "running"
            end_attempt(session, lease(session)[0], "out of memory")

        assert evaluation.state == "incomplete"
        assert evaluation.reason == f"{TASK} from episode 5: out of memory"
        assert [shard.state for shard in shards(session, evaluation)] == ["done", "failed"]
        assert lifecycle.next_shard(session) is None


def test_the_reason_says_how_many_shards_failed(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=11)
        lose_all(session)

        assert evaluation.reason == f"{TASK} from episode 0: it crashed (and 2 more shards)"


def test_one_failed_shard_does_not_stop_the_others(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        first = lifecycle.next_shard(session)
        for _ in range(FAULTS):
            attempt, shard = lease(session)
            assert shard is first
            end_attempt(session, attempt, "it crashed")

        assert evaluation.state == "running"
        assert ledgers.play_shard(session, store)
        assert evaluation.state == "incomplete"


def test_an_episode_that_could_not_be_played_is_tried_by_another_attempt(
    database: Database, store: Blobs
) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=2)
        attempt, shard = lease(session)
        one, other = shard.episodes
        lifecycle.begin(session, attempt, one)
        lifecycle.put_back(session, attempt, one, "no room for the recording")
        play(session, store, attempt, other)
        end_attempt(session, attempt, None)

        assert (one.state, other.state, shard.state) == ("pending", "final", "pending")
        faults = select(Event.payload).where(Event.kind == "fault")
        assert session.scalars(faults).all() == [
            {"id": one.id, "reason": "no room for the recording"}
        ]
        assert ledgers.play_shard(session, store)
        assert evaluation.state == "completed"


def test_a_final_episode_is_not_begun_again(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        ledgers.created(session, tasks=[TASK], episodes=2)
        attempt, shard = lease(session)
        play(session, store, attempt, shard.episodes[0])

        with pytest.raises(Problem, match="is final") as refused:
            lifecycle.begin(session, attempt, shard.episodes[0])
        assert (refused.value.status, refused.value.code) == (409, "episode_final")


# --- cancel ---


def test_cancelling_what_waits_ends_it_at_once(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        lifecycle.cancel(session, evaluation)

        assert (evaluation.state, evaluation.desired) == ("cancelled", "cancelled")
        assert {shard.state for shard in shards(session, evaluation)} == {"cancelled"}
        assert lifecycle.next_shard(session) is None


def test_cancelling_what_runs_waits_for_its_attempts(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        attempt, shard = lease(session)
        play(session, store, attempt, shard.episodes[0])
        lifecycle.cancel(session, evaluation)

        assert (evaluation.state, evaluation.desired) == ("running", "cancelled")
        assert lifecycle.next_shard(session) is None
        end_attempt(session, attempt, "cancelled")
        assert (evaluation.state, attempt.state, shard.state) == ("cancelled",) * 3
        assert shard.faults == 0
        assert [one.state for one in shard.episodes] == ["final"] + ["pending"] * 4


def test_what_finishes_although_it_was_cancelled_counts(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        attempt, shard = lease(session)
        lifecycle.cancel(session, evaluation)
        play(session, store, attempt, shard.episodes[0])
        end_attempt(session, attempt, None)

        assert evaluation.state == "completed"


def test_cancelling_an_incomplete_evaluation(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        lose_all(session)
        assert evaluation.state == "incomplete"
        lifecycle.cancel(session, evaluation)

        assert (evaluation.state, evaluation.reason) == ("cancelled", None)
        assert [shard.state for shard in shards(session, evaluation)] == ["cancelled"]


def test_cancelling_twice_is_fine(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        lifecycle.cancel(session, evaluation)
        lifecycle.cancel(session, evaluation)

        assert told(session, evaluation) == ["queued", "cancelled"]


def test_a_completed_evaluation_is_not_cancelled(database: Database, store: Blobs) -> None:
    id = ledgers.evaluated(database, store, tasks=[TASK], episodes=1)

    with database.writing() as session, pytest.raises(Problem, match="completed already"):
        lifecycle.cancel(session, session.get_one(Evaluation, id))


# --- resume ---


def test_a_resumed_evaluation_plays_what_is_missing(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        assert ledgers.play_shard(session, store)
        lose_all(session)
        done = {one.id: one.digest for one in ledgers.episodes_of(session, evaluation.id)[:5]}
        started = evaluation.started
        lifecycle.resume(session, evaluation, current_sources())

        assert (evaluation.state, evaluation.ended, evaluation.reason) == ("queued", None, None)
        assert ledgers.play_shard(session, store)
        assert not ledgers.play_shard(session, store)
        assert evaluation.state == "completed"
        assert evaluation.started == started
        after = {one.id: one.digest for one in ledgers.episodes_of(session, evaluation.id)}
        assert done.items() <= after.items()


def test_a_resumed_shard_has_all_its_tries_again(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        lose_all(session)
        lifecycle.resume(session, evaluation, current_sources())
        for _ in range(FAULTS - 1):
            end_attempt(session, lease(session)[0], "it crashed")

        assert evaluation.state == "running"
        [shard] = shards(session, evaluation)
        session.refresh(shard)
        assert (shard.faults, shard.fence) == (FAULTS - 1, 2 * FAULTS - 1)


@pytest.mark.parametrize("state", ["queued", "running", "completed", "cancelled"])
def test_only_an_incomplete_evaluation_resumes(
    database: Database, store: Blobs, state: str
) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        if state == "running":
            lease(session)
        if state == "completed":
            ledgers.play_shard(session, store)
        if state == "cancelled":
            lifecycle.cancel(session, evaluation)
        assert evaluation.state == state

        with pytest.raises(Problem, match=f"is {state}; only an incomplete one") as refused:
            lifecycle.resume(session, evaluation, current_sources())
        assert refused.value.status == 409


def test_an_evaluation_of_other_sources_does_not_resume(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        lose_all(session)

        with pytest.raises(Problem, match=f"The sources of {TASK} have changed"):
            lifecycle.resume(session, evaluation, current_sources() | {TASK: "other"})


# --- recover ---


def test_a_stop_of_the_server_is_no_fault(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        attempt, shard = lease(session)
        play(session, store, attempt, shard.episodes[0])
        lifecycle.begin(session, attempt, shard.episodes[1])
        lease(session)

    for restart in range(FAULTS + 1):
        with database.writing() as session:
            recovered = lifecycle.recover(session, current_sources())
            assert recovered == (2 if restart == 0 else 1)
            attempt, shard = lease(session)
            assert (shard.faults, attempt.fence) == (0, restart + 2)
            assert evaluation.state == "running"

    with database.writing() as session:
        lifecycle.recover(session, current_sources())
        while ledgers.play_shard(session, store):
            pass
        assert session.get_one(Evaluation, evaluation.id).state == "completed"


def test_recovering_finishes_a_cancellation(database: Database) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=1)
        lease(session)
        lifecycle.cancel(session, evaluation)
    with database.writing() as session:
        lifecycle.recover(session, current_sources())

        assert session.get_one(Evaluation, evaluation.id).state == "cancelled"


@pytest.mark.parametrize("begun", [False, True])
def test_what_other_sources_began_is_not_continued(
    database: Database, store: Blobs, begun: bool
) -> None:
    with database.writing() as session:
        evaluation = ledgers.created(session, tasks=[TASK], episodes=6)
        other = ledgers.created(session, tasks=["reopen_drawer"], episodes=1)
        if begun:
            ledgers.play_shard(session, store)
    with database.writing() as session:
        lifecycle.recover(session, current_sources() | {TASK: "other"})
        found = session.get_one(Evaluation, evaluation.id)

        assert found.state == "incomplete"
        assert found.reason is not None and "have changed since it began" in found.reason
        assert session.get_one(Evaluation, other.id).state == "queued"
        assert {shard.state for shard in shards(session, found)} <= {"done", "failed"}


def test_recovering_leaves_what_has_ended_alone(database: Database, store: Blobs) -> None:
    id = ledgers.evaluated(database, store, tasks=[TASK], episodes=1)

    with database.writing() as session:
        assert lifecycle.recover(session, {}) == 0
        assert session.get_one(Evaluation, id).state == "completed"
