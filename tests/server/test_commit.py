"""How an episode becomes final: once, whole, from the current attempt alone."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from hide_tasks.contract import Failure
from server import episodes, evaluations, lifecycle
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.models import Attempt, Blob, Decision, Divergence, Episode, Event, HiddenSpan
from server.problems import Problem
from tests.server import ledgers
from workers.protocol import EpisodeCommit, HiddenChange, measured_digest
from workers.sandbox.choice import Sandbox

pytestmark = pytest.mark.usefixtures("on_each_database")


class Ledger(NamedTuple):
    """A ledger with one shard handed out, and its first episode begun."""

    database: Database
    store: Blobs
    attempt: str
    episode: str
    other: str  # of the same shard, not begun


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    database = ledgers.opened(tmp_path)
    with database.writing() as session:
        ledgers.created(session, tasks=["search_drawer"], episodes=2)
        found = ledgers.leased(session)
        assert found is not None
        attempt, shard = found
        lifecycle.begin(session, attempt, shard.episodes[0])
        ids = [episode.id for episode in shard.episodes]
    yield Ledger(database, Blobs(tmp_path / "blobs"), attempt.id, *ids)
    database.close()


def result(ledger: Ledger, failure: Failure | None = None, episode: str = "") -> EpisodeCommit:
    with ledger.database.reading() as session:
        spec = lifecycle.spec_of(session.get_one(Episode, episode or ledger.episode))
    return ledgers.result_of(spec, failure)


def sealed(what: EpisodeCommit, **changes: object) -> EpisodeCommit:
    """What is sent, changed, with the digest that belongs to it."""
    what = what.model_copy(update=changes)
    digest = measured_digest(what.result, what.start, what.decisions, what.changes)
    return what.model_copy(update={"digest": digest})


def send(ledger: Ledger, what: EpisodeCommit, episode: str = "", attempt: str = "") -> object:
    with ledger.database.writing() as session:
        return commit(
            session,
            ledger.store,
            session.get_one(Attempt, attempt or ledger.attempt),
            session.get_one(Episode, episode or ledger.episode),
            what,
        )


def refused(ledger: Ledger, what: EpisodeCommit, episode: str = "", attempt: str = "") -> Problem:
    """The problem that keeps an episode from becoming final."""
    with pytest.raises(Problem) as raised:
        send(ledger, what, episode, attempt)
    with ledger.database.reading() as session:
        assert session.get_one(Episode, episode or ledger.episode).state != "final"
        assert session.scalar(select(func.count()).select_from(Decision)) == 0
    return raised.value


def count(session: Session, table: type) -> int:
    return session.scalar(select(func.count()).select_from(table)) or 0


def test_everything_that_was_measured_is_kept(ledger: Ledger) -> None:
    what = result(ledger, Failure.OVERCOUNT)

    answer = send(ledger, what)

    assert not isinstance(answer, Problem) and answer == type(answer)(already=False)
    with ledger.database.reading() as session:
        kept = episodes.get(session, ledger.episode)
        decisions = episodes.decisions(session, ledger.episode)
        changes = episodes.changes(session, ledger.episode)
    assert (kept.state, kept.success, kept.exact, kept.failure) == (
        "final",
        True,
        False,
        "overcount",
    )
    assert (kept.fence, kept.decisions, kept.stage) == (1, 3, "press 3")
    assert kept.timing == what.result.timing and kept.start == what.start
    assert kept.scene_hash == what.result.scene_hash
    assert [one.model_dump() for one in decisions] == [one.model_dump() for one in what.decisions]
    assert [one.model_dump() for one in changes] == [one.model_dump() for one in what.changes]


def test_the_sandbox_is_told_of_the_episode_and_of_its_evaluation(ledger: Ledger) -> None:
    send(ledger, result(ledger).model_copy(update={"sandbox": Sandbox.LANDLOCK}))

    with ledger.database.reading() as session:
        episode = episodes.get(session, ledger.episode)
        assert episode.sandbox is Sandbox.LANDLOCK
        assert evaluations.get(session, episode.evaluation).sandboxes == [Sandbox.LANDLOCK]


def test_followers_are_told(ledger: Ledger) -> None:
    send(ledger, result(ledger))

    with ledger.database.reading() as session:
        payload = session.scalar(select(Event.payload).order_by(Event.seq.desc()).limit(1))
    assert payload is not None
    assert (payload["id"], payload["state"], payload["exact"]) == (ledger.episode, "final", True)


def test_the_thumbnail_is_kept_under_its_hash(ledger: Ledger) -> None:
    what = result(ledger)
    send(ledger, what)

    with ledger.database.reading() as session:
        episode = session.get_one(Episode, ledger.episode)
        assert episode.thumbnail is not None
        blob = session.get_one(Blob, episode.thumbnail)
        content = ledger.store.path(blob.sha256).read_bytes()
    assert content == what.thumbnail and blob.size == len(content)


def test_hidden_values_may_be_empty_and_lists(ledger: Ledger) -> None:
    hidden = {"origin": None, "searched": ["top", None], "opened": False, "mass": 0.25}
    what = result(ledger)
    decisions = tuple(one.model_copy(update={"hidden": hidden}) for one in what.decisions)
    changes = tuple(one.model_copy(update={"hidden": hidden}) for one in what.changes)
    start = what.start.model_copy(update={"hidden": hidden})

    send(ledger, sealed(what, decisions=decisions, changes=changes, start=start))

    with ledger.database.reading() as session:
        spans = episodes.spans(session, ledger.episode)
    assert {one.name: one.value for one in spans if one.kind == "hidden"} == hidden


# --- twice ---


def test_the_same_result_twice_is_fine(ledger: Ledger) -> None:
    what = result(ledger)
    send(ledger, what)

    answer = send(ledger, what)

    assert answer.already
    with ledger.database.reading() as session:
        assert count(session, Divergence) == 0
        assert count(session, Decision) == 3


def test_what_the_clock_said_makes_no_other_result(ledger: Ledger) -> None:
    what = result(ledger)
    send(ledger, what)
    slower = what.result.model_copy(update={"timing": {"total": 99.0}})

    assert send(ledger, sealed(what, result=slower)).already


def test_another_result_of_a_final_episode_is_an_alarm(ledger: Ledger) -> None:
    first, second = result(ledger), result(ledger, Failure.OVERCOUNT)
    send(ledger, first)

    answer = send(ledger, second)

    assert isinstance(answer, Problem)
    assert (answer.status, answer.code) == (409, "diverged")
    with ledger.database.reading() as session:
        episode = session.get_one(Episode, ledger.episode)
        [alarm] = session.scalars(select(Divergence))
        kinds = session.scalars(select(Event.kind)).all()
        assert (episode.digest, episode.exact) == (first.digest, True)
        assert (alarm.kept, alarm.other) == (first.digest, second.digest)
        assert (alarm.attempt_id, alarm.result["failure"]) == (ledger.attempt, "overcount")
        assert kinds.count("divergence") == 1
        assert count(session, Decision) == 3


def test_a_lost_attempt_may_still_learn_that_its_result_is_there(ledger: Ledger) -> None:
    what = result(ledger)
    send(ledger, what)
    with ledger.database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, ledger.attempt), "it crashed")

    assert send(ledger, what).already


# --- refused ---


def test_an_ended_attempt_commits_nothing(ledger: Ledger) -> None:
    with ledger.database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, ledger.attempt), "it crashed")

    problem = refused(ledger, result(ledger))

    assert (problem.status, problem.code) == (409, "stale_attempt")


def test_a_superseded_attempt_commits_nothing(ledger: Ledger) -> None:
    with ledger.database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, ledger.attempt), "it crashed")
        found = ledgers.leased(session)
        assert found is not None
        lifecycle.begin(session, found[0], session.get_one(Episode, ledger.episode))

    assert refused(ledger, result(ledger)).code == "stale_attempt"
    assert not isinstance(send(ledger, result(ledger), attempt=found[0].id), Problem)


def test_an_attempt_commits_only_what_it_began(ledger: Ledger) -> None:
    problem = refused(ledger, result(ledger, episode=ledger.other), ledger.other)

    assert (problem.status, problem.code) == (409, "stale_attempt")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("task", "reopen_drawer"),
        ("split", "val"),
        ("index", 1),
        ("variation", {"item_in": "nowhere"}),
        ("scene_hash", "0" * 64),
    ],
)
def test_another_episodes_result_is_refused_by_name(
    ledger: Ledger, field: str, value: object
) -> None:
    what = result(ledger)
    wrong = what.result.model_copy(update={field: value})

    problem = refused(ledger, sealed(what, result=wrong))

    assert problem.status == 422
    assert [error["field"] for error in problem.errors] == [f"result.{field}"]


@pytest.mark.parametrize("digest", ["", "0" * 64, "no digest"])
def test_a_damaged_result_is_refused(ledger: Ledger, digest: str) -> None:
    problem = refused(ledger, result(ledger).model_copy(update={"digest": digest}))

    assert problem.status == 422 and problem.errors[0]["field"] == "digest"


def test_a_result_with_decisions_missing_is_refused(ledger: Ledger) -> None:
    what = result(ledger)

    problem = refused(ledger, sealed(what, decisions=what.decisions[:2]))

    assert problem.status == 422 and problem.errors[0]["field"] == "decisions"


@pytest.mark.parametrize("numbers", [(0, 0, 1), (1, 2, 3), (2, 1, 0), (0, 1, 10**30), (-1, 0, 1)])
def test_decisions_are_numbered_from_zero(ledger: Ledger, numbers: tuple[int, ...]) -> None:
    what = result(ledger)
    decisions = tuple(
        one.model_copy(update={"decision": number})
        for one, number in zip(what.decisions, numbers, strict=True)
    )

    problem = refused(ledger, sealed(what, decisions=decisions))

    assert problem.status == 422 and problem.errors[0]["field"] == "decisions"


@pytest.mark.parametrize(
    "change",
    [
        {"time": float("nan")},
        {"time": float("inf")},
        {"time": -1.0},
        {"decision": -1},
        {"decision": 4},
        {"decision": 10**30},
        {"hidden": {"mass": float("nan")}},
        {"hidden": {"masses": [1.0, float("inf")]}},
    ],
)
def test_a_change_at_no_moment_of_the_episode_is_refused(
    ledger: Ledger, change: dict[str, object]
) -> None:
    what = result(ledger)
    fields = {"time": 1.0, "decision": 0, "stage": "press 1", "hidden": {"mass": 0.5}} | change
    changes = (*what.changes, HiddenChange.model_validate(fields))

    problem = refused(ledger, sealed(what, changes=changes))

    assert problem.status == 422 and problem.errors[0]["field"] == "changes"


@pytest.mark.parametrize(
    "recording",
    ["a" * 64, "", "ab", "../../ledger.sqlite3", "ab/etc/hostname", "A" * 64, "a" * 63 + "\n"],
)
def test_a_recording_that_was_not_sent_is_refused(ledger: Ledger, recording: str) -> None:
    what = result(ledger).model_copy(update={"recording": recording})

    problem = refused(ledger, what)

    assert problem.status == 422 and problem.errors[0]["field"] == "recording"


def test_a_recording_that_was_sent_is_kept(ledger: Ledger) -> None:
    sha256 = ledger.store.put(b"RRF2 and more")

    send(ledger, result(ledger).model_copy(update={"recording": sha256}))

    with ledger.database.reading() as session:
        assert session.get_one(Episode, ledger.episode).recording == sha256
        blob = session.get_one(Blob, sha256)
        assert (blob.size, blob.media_type) == (13, "application/vnd.rerun.rrd")


def test_two_episodes_may_end_with_the_same_picture(ledger: Ledger) -> None:
    send(ledger, result(ledger))
    with ledger.database.writing() as session:
        attempt = session.get_one(Attempt, ledger.attempt)
        lifecycle.begin(session, attempt, session.get_one(Episode, ledger.other))

    send(ledger, result(ledger, episode=ledger.other), ledger.other)

    with ledger.database.reading() as session:
        assert count(session, Blob) == 1


def test_a_picture_without_its_row_is_no_hindrance(ledger: Ledger) -> None:
    """The server was killed between writing the blob and committing the episode."""
    what = result(ledger)
    assert what.thumbnail is not None
    ledger.store.put(what.thumbnail)

    send(ledger, what)

    with ledger.database.reading() as session:
        assert count(session, Blob) == 1


def test_a_commit_that_fails_leaves_nothing_in_the_ledger(ledger: Ledger) -> None:
    with pytest.raises(RuntimeError, match="power cut"), ledger.database.writing() as session:
        commit(
            session,
            ledger.store,
            session.get_one(Attempt, ledger.attempt),
            session.get_one(Episode, ledger.episode),
            result(ledger),
        )
        raise RuntimeError("power cut")

    with ledger.database.reading() as session:
        assert session.get_one(Episode, ledger.episode).state == "running"
        assert [count(session, table) for table in (Decision, Blob, HiddenSpan)] == [0, 0, 0]
    assert not isinstance(send(ledger, result(ledger)), Problem)


def test_what_travels_survives_json(ledger: Ledger) -> None:
    what = result(ledger)

    again = EpisodeCommit.model_validate(json.loads(what.model_dump_json()))

    assert send(ledger, again) == send(ledger, what).model_copy(update={"already": False})
