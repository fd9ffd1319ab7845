"""What an evaluation would cost, told before it is asked for."""

from pathlib import Path
from typing import Any

import pytest

from hide_tasks import SUITES
from tests.server import ledgers
from tests.server.clients import API, SMALL, TestClient, create, hub_of, problem_of
from tests.server.people import peopled, token_of, visitor
from workers.engines.local import LocalEngine
from workers.supervisor import run_shard


class TwoSlots:
    """As a reconciler with two workers says it."""

    def slots(self) -> int:
        return 2

    def stop(self) -> None: ...


@pytest.fixture
def playing(here: TestClient) -> TestClient:
    """A server that could hand out to two workers; no process is started."""
    hub = hub_of(here)
    hub.engine, hub.reconciler = LocalEngine(run_shard, workers=2), TwoSlots()  # type: ignore[assignment]
    return here


def estimate(here: TestClient, **wanted: Any) -> dict[str, Any]:
    answer = here.get(f"{API}/evaluations/estimate", params={"policy": "expert", **wanted})
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def test_a_whole_suite_is_375_episodes_and_ranked(playing: TestClient) -> None:
    found = estimate(playing)

    assert (found["episodes"], found["shards"]) == (375, 75)
    assert set(found["tasks"]) == set(SUITES["hide"])
    assert (found["covers"], found["ranked"]) == ("full", True)
    assert not estimate(playing, split="test", episodes=24)["ranked"]
    assert estimate(playing, suite="real4")["ranked"]
    assert not estimate(playing, rules="parity")["ranked"]
    assert playing.get(f"{API}/evaluations").json()["items"] == []


def test_a_pace_is_the_policys_own_else_of_its_kind_else_assumed(playing: TestClient) -> None:
    hub = hub_of(playing)
    assumed = estimate(playing, **SMALL)
    ledgers.evaluated(hub.database, hub.blobs, "noop", **{"tasks": ["search_drawer"]})
    kind = estimate(playing, **SMALL)
    ledgers.evaluated(hub.database, hub.blobs, "expert", **{"tasks": ["search_drawer"]})
    own = estimate(playing, **SMALL)
    partly = estimate(playing, tasks=["search_drawer", "search_boxes"], episodes=1)
    ledgers.registered(hub.database, "mine")
    others = estimate(playing, **SMALL | {"policy": "mine"})

    bases = [one["basis"] for one in (assumed, kind, own, partly, others)]
    assert bases == ["assumed", "kind", "policy", "assumed", "others"]
    # two episodes of 0.5 s, by two workers
    assert own["seconds"] == pytest.approx(0.5)
    assert own["per_minute"] == pytest.approx(240)
    assert "search_drawer" in partly["tasks"] and "assumed" in partly["basis_detail"]


def test_what_goes_before_it_is_counted(playing: TestClient) -> None:
    create(playing, episodes=10)
    create(playing, episodes=10, priority=-3)

    usual, last, first = (estimate(playing, **SMALL, priority=number) for number in (0, -5, 5))

    assert (usual["evaluations_before"], usual["shards_before"]) == (1, 2)
    assert (last["evaluations_before"], last["shards_before"]) == (2, 4)
    assert (first["evaluations_before"], first["seconds_before"]) == (0, 0)
    # one of the same priority takes turns with it; of a higher one all goes first
    assert usual["seconds_before"] == pytest.approx(usual["seconds"])
    assert last["seconds_before"] == pytest.approx(10 * last["seconds"])


def test_a_remote_policys_server_bounds_the_workers(playing: TestClient) -> None:
    from server import policies
    from tests.workers.remote.peers import declared

    spec = declared("ws://far:1", concurrency=1, dialect="openpi")
    with hub_of(playing).database.writing() as session:
        policies.register(session, "far", spec)

    assert estimate(playing, policy="far")["workers"] == 1
    assert estimate(playing)["workers"] == 2


def test_without_workers_there_is_no_time(here: TestClient) -> None:
    found = estimate(here)

    assert (found["workers"], found["seconds"], found["per_minute"]) == (0, None, None)


@pytest.mark.parametrize(
    ("wanted", "field"),
    [
        ({"policy": "exprt"}, "policy"),
        ({"tasks": ["serch_drawer"]}, "tasks"),
        ({"episodes": "26"}, "episodes"),
        ({"episodes": "many"}, "episodes"),
        ({"split": "best"}, "split"),
        ({"priority": "101"}, "priority"),
        ({"fast": "yes"}, "fast"),
    ],
)
def test_it_refuses_what_the_evaluation_would_be_refused_for(
    here: TestClient, wanted: dict[str, Any], field: str
) -> None:
    answer = here.get(f"{API}/evaluations/estimate", params={"policy": "expert", **wanted})

    assert answer.status_code == 422
    assert [one["field"] for one in problem_of(answer)["errors"]] == [field]


def test_a_quota_that_is_used_up_is_said_before(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_attempts=1) as app:
        asking = visitor(app, token_of(app, "submitter"))
        path = f"{API}/evaluations/estimate"
        before = asking.get(path, params=SMALL).json()
        assert asking.post(f"{API}/evaluations", json=SMALL).status_code == 202
        after = asking.get(path, params=SMALL).json()
        urgent = asking.get(path, params=SMALL | {"priority": 1})

    assert before["refused"] is None and before["quotas"]["attempts"] == {"used": 0, "limit": 1}
    assert "quota of 1 evaluations in 24 hours is used up" in after["refused"]
    assert urgent.status_code == 422 and "for maintainers" in problem_of(urgent)["detail"]
