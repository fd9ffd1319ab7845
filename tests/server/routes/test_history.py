"""How an evaluation went: lanes, what its time was spent on, what happened in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import event

from hide_tasks.contract import Failure
from server import lifecycle, models
from server.commit import commit
from server.hub import WORKERS_LOG
from server.models import Attempt, Evaluation
from tests.server import ledgers
from tests.server.clients import API, SMALL, TestClient, create, hub_of

START = datetime(2026, 3, 1, 12, tzinfo=models.UTC)


class Clock:
    """Moves only when it is told to."""

    def __init__(self) -> None:
        self.time = START

    def __call__(self) -> datetime:
        return self.time

    def after(self, seconds: float) -> None:
        self.time += timedelta(seconds=seconds)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(models, "clock", found)
    return found


class Hand:
    """Plays by hand what is leased, at the times of a clock."""

    def __init__(self, here: TestClient, clock: Clock):
        self.hub, self.clock = hub_of(here), clock

    def lease(self) -> str:
        with self.hub.database.writing() as session:
            found = ledgers.leased(session)
            assert found
            return found[0].id

    @contextmanager
    def at(self, attempt: str) -> Iterator[tuple[Any, Attempt]]:
        with self.hub.database.writing() as session:
            yield session, session.get_one(Attempt, attempt)

    def begin(self, attempt: str) -> None:
        with self.at(attempt) as (session, one):
            lifecycle.begin(session, one, lifecycle.open_episodes(one.shard)[0])

    def finish(self, attempt: str, failure: Failure | None = None) -> None:
        with self.at(attempt) as (session, one):
            episode = lifecycle.open_episodes(one.shard)[0]
            what = ledgers.result_of(lifecycle.spec_of(episode), failure)
            commit(session, self.hub.blobs, one, episode, what)

    def end(self, attempt: str, reason: str | None = None) -> None:
        with self.at(attempt) as (session, one):
            lifecycle.end_attempt(session, one, reason)


@pytest.fixture
def hand(here: TestClient, clock: Clock) -> Hand:
    return Hand(here, clock)


def history(here: TestClient, id: str) -> dict[str, Any]:
    document: dict[str, Any] = here.get(f"{API}/evaluations/{id}/history").json()
    return document


def test_what_is_played_at_a_time_lies_in_lanes_beside_each_other(
    here: TestClient, clock: Clock, hand: Hand
) -> None:
    id = create(here, tasks=["search_drawer", "search_boxes"], episodes=1)["id"]
    one, two = hand.lease(), hand.lease()
    hand.begin(one)
    clock.after(5)
    hand.begin(two)
    clock.after(5)
    hand.finish(one, Failure.WRONG_RECALL)
    hand.end(one)

    found = history(here, id)

    outcomes = [[span["outcome"] for span in lane["spans"]] for lane in found["lanes"]]
    assert outcomes == [["failed"], ["running"]]
    assert found["running"] and found["seconds"] == {"playing": 10}


def test_a_try_that_was_lost_stays_to_be_seen(here: TestClient, clock: Clock, hand: Hand) -> None:
    id = create(here, episodes=1)["id"]
    clock.after(60)
    first = hand.lease()
    clock.after(3)
    hand.begin(first)
    clock.after(10)
    hand.end(first, "its worker disappeared")
    clock.after(20)
    second = hand.lease()
    hand.begin(second)
    clock.after(7)
    hand.finish(second)
    hand.end(second)

    found = history(here, id)

    [lane] = found["lanes"]
    assert [span["outcome"] for span in lane["spans"]] == ["lost", "exact"]
    phases = [(one["activity"], one["detail"]) for one in found["phases"]]
    assert [activity for activity, _ in phases] == [
        "queued", "starting", "lost", "waiting", "playing"
    ]  # fmt: skip
    assert phases[2][1] == "a try was lost: its worker disappeared"
    assert "after an attempt was lost" in phases[3][1]
    assert found["seconds"] == {
        "queued": 60, "starting": 3, "lost": 10, "waiting": 20, "playing": 7
    }  # fmt: skip
    assert not found["running"]


def test_waiting_says_who_was_played_meanwhile(here: TestClient, clock: Clock, hand: Hand) -> None:
    create(here, policy="noop", episodes=1)
    mine = create(here, episodes=1)["id"]
    others = hand.lease()
    hand.begin(others)
    clock.after(30)
    hand.finish(others)
    hand.end(others)
    clock.after(30)

    [phase] = history(here, mine)["phases"]

    assert (phase["activity"], phase["detail"]) == ("queued", "workers played noop@1")


def test_a_lost_try_has_the_reason_of_its_own_shard(
    here: TestClient, clock: Clock, hand: Hand
) -> None:
    mine = create(here, tasks=["search_drawer", "search_boxes"], episodes=1)["id"]
    first = hand.lease()
    clock.after(1)
    second = hand.lease()
    for attempt, reason in ((second, "out of memory"), (first, "no disk")):
        hand.begin(attempt)
        clock.after(10)
        hand.end(attempt, reason)

    lost = [one["detail"] for one in history(here, mine)["phases"] if one["activity"] == "lost"]

    assert lost == ["a try was lost: out of memory", "a try was lost: no disk"]


def test_many_waits_take_no_more_questions_than_one(
    here: TestClient, clock: Clock, hand: Hand
) -> None:
    tasks = ["search_drawer", "search_boxes", "lift_and_check", "reopen_drawer"]
    mine = create(here, tasks=tasks, episodes=1)["id"]
    asked: list[str] = []
    event.listen(hand.hub.database.engine, "before_cursor_execute", lambda *a: asked.append(a[2]))
    counted = []
    for _ in tasks:
        clock.after(30)
        played = hand.lease()
        hand.begin(played)
        clock.after(30)
        hand.finish(played)
        hand.end(played)
        tried = []
        for _ in range(3):  # what runs in the background may ask as well
            asked.clear()
            phases = history(here, mine)["phases"]
            tried.append(len(asked))
        waits = [one for one in phases if one["activity"] != "playing"]
        counted.append((len(waits), min(tried)))

    assert [waits for waits, _ in counted] == [1, 2, 3, 4]
    assert len({questions for _, questions in counted}) == 1


def test_a_server_that_did_not_run_is_told_apart(
    here: TestClient, clock: Clock, hand: Hand
) -> None:
    id = create(here, episodes=1)["id"]
    attempt = hand.lease()
    hand.begin(attempt)
    clock.after(605)
    with hand.hub.database.writing() as session:
        lifecycle.recover(session, session.get_one(Evaluation, id).sources)
    clock.after(2)

    found = history(here, id)

    assert [one["activity"] for one in found["phases"]] == ["stopped", "waiting"]
    assert "took its work back" in found["phases"][0]["detail"]
    assert found["seconds"] == {"stopped": 605, "waiting": 2}


def test_the_log_says_in_words_what_happened(here: TestClient, hand: Hand) -> None:
    id = create(here, episodes=2)["id"]
    attempt = hand.lease()
    hand.begin(attempt)
    hand.finish(attempt, Failure.WRONG_RECALL)
    hand.end(attempt, "the worker was killed")

    page = here.get(f"{API}/evaluations/{id}/log", params={"limit": 3}).json()
    rest = here.get(f"{API}/evaluations/{id}/log", params={"cursor": page["next"]}).json()
    lines = [one["text"] for one in [*page["items"], *rest["items"]][::-1]]

    assert lines == [
        "queued",
        "begun: its first shard was handed out",
        "search_drawer 0 begins",
        "search_drawer 0: failed, wrong recall",
        "search_drawer, attempt 1 of a shard: lost; what it left goes back to the queue "
        "(the worker was killed)",
    ]
    assert page["items"][1]["episode"]


def test_a_stop_on_request_is_no_fault(here: TestClient, hand: Hand) -> None:
    id = create(here, episodes=2)["id"]
    attempt = hand.lease()
    here.post(f"{API}/evaluations/{id}/cancellation")
    hand.end(attempt)

    lines = here.get(f"{API}/evaluations/{id}/log").json()["items"]

    assert [one["level"] for one in lines if "stopped on request" in one["text"]] == [""]


def test_the_end_of_what_workers_printed(here: TestClient) -> None:
    path = f"{API}/workers/log"
    assert here.get(path).json() == {"lines": []}

    hub_of(here).folder.logs.joinpath(WORKERS_LOG).write_text("x" * 20_000 + "\nTraceback\nb\xe9")

    assert here.get(path).json() == {"lines": ["Traceback", "bé"]}


# --- afterwards ---


def test_a_rerun_asks_for_the_same_again(here: TestClient) -> None:
    first = create(here, episodes=3, split="val", rules="parity", priority=5, recordings=False)

    again = here.post(f"{API}/evaluations/{first['id']}/rerun")

    assert again.status_code == 202
    found = again.json()
    assert found["id"] != first["id"]
    assert again.headers["location"] == f"/api/v1/evaluations/{found['id']}"
    same = ("policy", "version", "tasks", "split", "episodes", "rules", "recordings")
    assert [found[name] for name in same] == [first[name] for name in same]
    assert found["priority"] == 0  # whoever asks now need not be a maintainer


def publication(here: TestClient, id: str) -> dict[str, Any]:
    document: dict[str, Any] = here.get(f"{API}/evaluations/{id}/publication").json()
    return document


def test_only_what_is_whole_is_published(here: TestClient) -> None:
    hub = hub_of(here)
    running = create(here)["id"]
    queued = here.post(f"{API}/evaluations/{running}/publication")
    lifecycle_cancel = here.post(f"{API}/evaluations/{running}/cancellation")
    part = ledgers.evaluated(hub.database, hub.blobs, **SMALL)
    partial = here.post(f"{API}/evaluations/{part}/publication")

    assert lifecycle_cancel.status_code == 202
    assert (queued.status_code, partial.status_code) == (409, 409)
    assert queued.json()["code"] == "not_publishable"
    assert "every episode is final" in queued.json()["detail"]
    assert "lacks 14 of the suite's 15 tasks" in partial.json()["detail"]
    assert publication(here, part) == {
        "publishable": False, "reason": partial.json()["detail"], "snapshots": []
    }  # fmt: skip


def test_publishing_keeps_the_leaderboard_once(here: TestClient) -> None:
    hub = hub_of(here)
    whole = ledgers.evaluated(hub.database, hub.blobs)

    first, second = (here.post(f"{API}/evaluations/{whole}/publication") for _ in range(2))

    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json()
    assert first.json()["note"].startswith("expert@1 is published")
    assert publication(here, whole)["snapshots"] == [first.json()]


def test_what_a_newer_one_supersedes_is_not_published(here: TestClient) -> None:
    hub = hub_of(here)
    old, new = (ledgers.evaluated(hub.database, hub.blobs) for _ in range(2))

    assert new in publication(here, old)["reason"]
    assert publication(here, new)["publishable"]


def test_what_is_whole_of_another_suite_is_published_on_its_leaderboard(here: TestClient) -> None:
    hub = hub_of(here)
    usual = ledgers.evaluated(hub.database, hub.blobs)
    hard = ledgers.evaluated(hub.database, hub.blobs, suite="hide-hard")

    assert publication(here, usual)["publishable"]  # a newer one of another suite is none
    kept = here.post(f"{API}/evaluations/{hard}/publication").json()

    assert kept["suite"] == "hide-hard"
    content = here.get(kept["content"]).json()
    assert [one["evaluation"] for one in content["evaluations"]] == [hard]
    assert publication(here, hard)["snapshots"] == [kept]
    assert publication(here, usual)["snapshots"] == []


def test_a_newer_part_supersedes_nothing(here: TestClient) -> None:
    hub = hub_of(here)
    whole = ledgers.evaluated(hub.database, hub.blobs)
    ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"])

    assert publication(here, whole)["publishable"]
