"""The queue and the workers over HTTP."""

import pytest

from server import lifecycle, policies
from server.models import Attempt, Evaluation
from server.waiting import queue
from tests.server import ledgers
from tests.server.clients import (
    API,
    TestClient,
    Worker,
    create,
    hub_of,
    problem_of,
)
from workers.engines.local import LocalEngine
from workers.protocol import RemotePolicy
from workers.supervisor import run_shard


@pytest.fixture
def playing(here: TestClient) -> TestClient:
    """A server that could hand out; its engine does nothing yet, so no process is started."""
    hub_of(here).engine = LocalEngine(run_shard, workers=1)
    return here


def told(here: TestClient) -> list[tuple[str, int, int, str]]:
    items = here.get(f"{API}/queue").json()["items"]
    assert [one["position"] for one in items] == list(range(1, len(items) + 1))
    return [(one["evaluation"], one["waiting"], one["before"], one["reason"]) for one in items]


def test_who_waits_in_which_order_and_why(playing: TestClient) -> None:
    first = create(playing, episodes=10)["id"]
    second = create(playing)["id"]
    urgent = create(playing, priority=5)["id"]

    assert told(playing) == [
        (urgent, 1, 0, "workers_busy"),
        (first, 2, 1, "others_first"),
        (second, 1, 3, "others_first"),
    ]
    found = playing.get(f"{API}/queue", params={"limit": 1}).json()
    assert (found["evaluations"], found["shards"], len(found["items"])) == (3, 4, 1)


def test_the_queue_is_the_order_in_which_shards_are_handed_out(playing: TestClient) -> None:
    for priority, episodes in ((0, 12), (1, 6), (0, 3), (-1, 5), (1, 12)):
        create(playing, priority=priority, episodes=episodes)
    hub = hub_of(playing)

    while found := told(playing):
        with hub.database.writing() as session:
            taken = ledgers.leased(session)
            assert taken and taken[1].evaluation_id == found[0][0]


def test_a_place_in_the_queue(playing: TestClient) -> None:
    create(playing)
    mine = create(playing)["id"]

    place = playing.get(f"{API}/evaluations/{mine}/queue").json()

    assert (place["position"], place["evaluation"], place["before"]) == (2, mine, 1)
    assert place["detail"] == "1 shard is handed out before."


def test_what_does_not_wait_has_no_place(playing: TestClient) -> None:
    mine = create(playing)["id"]
    with hub_of(playing).database.writing() as session:
        lifecycle.cancel(session, session.get_one(Evaluation, mine))

    answer = playing.get(f"{API}/evaluations/{mine}/queue")

    assert answer.status_code == 404 and "No shard" in problem_of(answer)["detail"]
    assert told(playing) == []


def test_a_server_without_workers_says_so(here: TestClient) -> None:
    create(here)

    assert [reason for *_, reason in told(here)] == ["no_workers"]


def test_a_full_disk_is_the_reason(playing: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    create(playing)
    monkeypatch.setattr("server.hub.RESERVE", 2**80)

    assert [reason for *_, reason in told(playing)] == ["disk_full"]


def test_a_remote_policy_that_plays_its_most_is_the_reason(playing: TestClient) -> None:
    hub = hub_of(playing)
    spec = RemotePolicy(url="wss://policy.example.org", concurrency=1)
    with hub.database.writing() as session:
        policies.register(session, "far", spec)
    far = create(playing, policy="far", episodes=10)["id"]
    near = create(playing)["id"]
    Worker(hub, playing)

    assert told(playing) == [
        (near, 1, 0, "workers_busy"),
        (far, 1, 1, "policy_busy"),
    ]


def test_workers_tell_what_they_do(playing: TestClient) -> None:
    create(playing, episodes=7)
    hub = hub_of(playing)
    worker, idle = Worker(hub, playing), Worker(hub, playing)
    worker.start(worker.episodes[0])
    worker.finish(worker.episodes[0])
    between = playing.get(f"{API}/workers").json()
    worker.start(worker.episodes[1])

    found = playing.get(f"{API}/workers").json()

    first, second = found["items"]
    assert [one["doing"] for one in between["items"]] == ["between", "begins"]
    assert (found["playing"], [one["doing"] for one in found["items"]]) == (1, ["plays", "begins"])
    assert (first["episode"], first["index"]) == (worker.episodes[1], 1)
    assert (first["final"], first["episodes"], second["episodes"]) == (1, 5, 2)
    assert first["episode_since"] and first["policy"] == "expert"
    assert (second["attempt"], second["episode"]) == (idle.attempt, None)


def test_an_attempt_that_ended_is_no_worker(playing: TestClient) -> None:
    create(playing)
    hub = hub_of(playing)
    worker = Worker(hub, playing)
    worker.start(worker.episodes[0])
    with hub.database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, worker.attempt), "killed")
    again = Worker(hub, playing)

    [one] = playing.get(f"{API}/workers").json()["items"]

    assert (one["attempt"], one["fence"], one["doing"]) == (again.attempt, 2, "begins")


def test_the_whole_queue_is_counted_where_only_its_head_is_told(playing: TestClient) -> None:
    for _ in range(3):
        create(playing)
    hub = hub_of(playing)

    with hub.database.reading() as session:
        found = queue(session, hub, limit=2)

    assert (found.evaluations, len(found.items)) == (3, 2)
