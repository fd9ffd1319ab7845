"""Evaluations as they stand: their progress, their lists, and what may be asked for."""

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy.orm import Session

from hide_tasks.contract import Failure
from server import evaluations, lifecycle, policies
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.models import Evaluation
from server.problems import Problem
from server.schemas.evaluations import EvaluationCreate
from server.states import EvaluationState
from tests.server import ledgers
from workers.protocol import RemotePolicy

SMALL = {"tasks": ["search_drawer"], "episodes": 5}


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def store(tmp_path: Path) -> Blobs:
    return Blobs(tmp_path / "blobs")


def play(session: Session, store: Blobs, count: int) -> str:
    """Commits so many episodes of the next shard, one a second, and begins one more."""
    found = ledgers.leased(session)
    assert found is not None
    attempt, shard = found
    for episode in shard.episodes[: count + 1]:
        lifecycle.begin(session, attempt, episode)
    for number, episode in enumerate(shard.episodes[:count]):
        failure = Failure.UNDERCOUNT if number == 0 else None
        commit(
            session, store, attempt, episode, ledgers.result_of(lifecycle.spec_of(episode), failure)
        )
    session.flush()
    return shard.evaluation_id


def everything(session: Session, limit: int, **filters: object) -> list[str]:
    """The ids of all pages, in order."""
    found, cursor = [], None
    while True:
        page = evaluations.listed(session, limit=limit, cursor=cursor, **filters)
        assert len(page.items) <= limit
        found += [one.id for one in page.items]
        if (cursor := page.next) is None:
            return found


def test_progress_counts_episodes(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        ledgers.created(session, **SMALL)
        id = play(session, store, 3)
        stands = evaluations.get(session, id)

    assert (stands.progress.expected, stands.progress.final, stands.progress.running) == (5, 3, 1)
    assert (stands.verdicts.success.successes, stands.verdicts.success.episodes) == (2, 3)
    assert stands.reason is None


def test_the_pace_is_told_while_it_runs(
    database: Database, store: Blobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(range(1000))
    now = lifecycle.now()
    monkeypatch.setattr("server.commit.now", lambda: now + timedelta(seconds=2 * next(clock)))
    with database.writing() as session:
        ledgers.created(session, **SMALL)
        id = play(session, store, 3)
        progress = evaluations.get(session, id).progress

    assert progress.per_minute == pytest.approx(30)
    assert progress.seconds_left == pytest.approx(4)


@pytest.mark.parametrize("committed", [0, 1])
def test_one_episode_says_nothing_of_the_pace(
    database: Database, store: Blobs, committed: int
) -> None:
    with database.writing() as session:
        ledgers.created(session, **SMALL)
        id = play(session, store, committed)
        progress = evaluations.get(session, id).progress

    assert (progress.per_minute, progress.seconds_left) == (None, None)


def test_what_is_being_stopped_says_so(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        ledgers.created(session, **SMALL)
        id = play(session, store, 1)
        lifecycle.cancel(session, evaluations.row(session, id))

        assert evaluations.get(session, id).reason == "stopping what runs"


def test_evaluations_are_listed_from_the_newest(database: Database) -> None:
    with database.writing() as session:
        ids = [ledgers.created(session, **SMALL).id for _ in range(3)]

        assert everything(session, 50) == ids[::-1]


def test_filters(database: Database, store: Blobs) -> None:
    ledgers.registered(database, "mine")
    done = ledgers.evaluated(database, store, "mine", **SMALL)
    with database.writing() as session:
        waits = ledgers.created(session, "noop", **SMALL).id

        assert everything(session, 50, state=EvaluationState.COMPLETED) == [done]
        assert everything(session, 50, state=EvaluationState.QUEUED) == [waits]
        assert everything(session, 50, policy="mine") == [done]
        assert everything(session, 50, policy="mine", state=EvaluationState.QUEUED) == []


def test_pages_show_everything_once_while_more_is_added(database: Database) -> None:
    with database.writing() as session:
        there = [
            ledgers.created(session, tasks=["search_drawer"], episodes=1).id for _ in range(23)
        ]
    found, cursor = [], None
    while True:
        with database.writing() as session:
            page = evaluations.listed(session, limit=7, cursor=cursor)
            found += [one.id for one in page.items]
            ledgers.created(session, tasks=["search_drawer"], episodes=1)
        if (cursor := page.next) is None:
            break

    assert found == there[::-1]


@pytest.mark.parametrize("limit", [1, 2, 3, 4])
def test_a_last_page_that_is_full_has_no_next(database: Database, limit: int) -> None:
    with database.writing() as session:
        ids = [ledgers.created(session, **SMALL).id for _ in range(3)]

        assert everything(session, limit) == ids[::-1]


@pytest.mark.parametrize("cursor", ["nonsense", "", "W10", "WyJhIiwiYiIsM10", "e30", "🙂"])
def test_a_foreign_cursor_is_refused(database: Database, cursor: str) -> None:
    with database.reading() as session, pytest.raises(Problem, match="not given out") as refused:
        evaluations.listed(session, cursor=cursor)

    assert (refused.value.status, refused.value.errors[0]["field"]) == (422, "cursor")


def test_every_attempt_is_told_the_newest_first(database: Database, store: Blobs) -> None:
    with database.writing() as session:
        id = ledgers.created(session, tasks=["search_drawer"], episodes=1).id
        found = ledgers.leased(session)
        assert found is not None
        lifecycle.end_attempt(session, found[0], "it crashed")
        ledgers.play_shard(session, store)

        told = [(one.fence, one.state, one.reason) for one in evaluations.attempts(session, id)]
    assert told == [(2, "done", None), (1, "lost", "it crashed")]


def test_the_machine_and_the_sources_are_kept(database: Database) -> None:
    with database.writing() as session:
        id = ledgers.created(session, **SMALL).id
    with database.reading() as session:
        kept = session.get_one(Evaluation, id)

        assert kept.sources == {"search_drawer": evaluations.current_sources()["search_drawer"]}
        assert kept.machine


@pytest.mark.parametrize("text", ["expert", "expert@1"])
def test_a_policy_by_its_name(database: Database, text: str) -> None:
    with database.writing() as session:
        created = evaluations.create(session, EvaluationCreate(policy=text, episodes=1))

        assert created.policy_version.policy.name == "expert"


def test_a_task_that_is_named_twice_is_played_once(database: Database) -> None:
    with database.writing() as session:
        created = ledgers.created(session, tasks=["search_drawer"] * 2, episodes=2)

        assert evaluations.get(session, created.id).progress.expected == 2


@pytest.mark.parametrize("category", ["RC", "HSR"])
def test_a_category_chooses_its_tasks(database: Database, category: str) -> None:
    with database.writing() as session:
        created = ledgers.created(session, category=category, episodes=1)
        found = {one.category for one in ledgers.episodes_of(session, created.id)}

    assert found == {category}


def test_weights_of_another_suite_are_refused(database: Database, store: Blobs) -> None:
    ledgers.uploaded(database, store, "seek-x", b"weights")

    with database.writing() as session, pytest.raises(Problem) as raised:
        ledgers.created(session, "seek-x", tasks=["real_stack_cups"], episodes=1)

    assert raised.value.status == 422
    assert raised.value.errors[0]["field"] == "policy"
    assert "was trained on suite hide; these tasks are of real4" in str(raised.value)


def test_a_remote_policy_that_wants_a_camera_which_is_not_there_is_refused(
    database: Database,
) -> None:
    spec = RemotePolicy.model_validate(
        {
            "url": "ws://127.0.0.1:1",
            "observation": {"image": {"from": "wrist.rgb"}},
            "action": {"kind": "action"},
        }
    )
    with database.writing() as session:
        policies.register(session, "there", spec)

    with database.writing() as session, pytest.raises(Problem, match="is to see the camera wrist"):
        ledgers.created(session, "there", tasks=["real_stack_cups"], episodes=1)
