"""Evaluations over HTTP: asked for, stopped, resumed, many at once."""

from pathlib import Path

from hide_tasks import SUITES
from server.lifecycle import FAULTS
from tests.server.clients import (
    API,
    SMALL,
    TestClient,
    Worker,
    client,
    create,
    ended,
    hub_of,
    problem_of,
)


def test_a_new_evaluation_is_where_its_location_says(here: TestClient) -> None:
    answer = here.post(f"{API}/evaluations", json=SMALL | {"priority": 3, "recordings": False})

    created = answer.json()
    assert answer.status_code == 202
    assert here.get(answer.headers["location"]).json() == created
    assert (created["state"], created["priority"], created["recordings"]) == ("queued", 3, False)
    assert created["progress"] == {
        "expected": 2, "final": 0, "running": 0, "per_minute": None, "seconds_left": None,
    }  # fmt: skip
    assert created["reason"] == "waits for a worker"
    assert created["verdicts"]["success"]["value"] is None


def test_by_default_all_of_the_suite_is_played(here: TestClient) -> None:
    created = here.post(f"{API}/evaluations", json={"policy": "noop"}).json()

    assert sorted(created["tasks"]) == sorted(SUITES["hide"])
    assert created["progress"]["expected"] == 25 * len(SUITES["hide"])


def test_an_idempotency_key_makes_one_evaluation(here: TestClient) -> None:
    headers = {"Idempotency-Key": "the first"}

    first = here.post(f"{API}/evaluations", json=SMALL, headers=headers)
    again = here.post(f"{API}/evaluations", json=SMALL | {"priority": 0}, headers=headers)

    assert (first.status_code, again.status_code) == (202, 202)
    assert first.json() == again.json()
    assert len(here.get(f"{API}/evaluations").json()["items"]) == 1


def test_an_idempotency_key_belongs_to_one_request(here: TestClient) -> None:
    headers = {"Idempotency-Key": "the first"}
    here.post(f"{API}/evaluations", json=SMALL, headers=headers)

    other = here.post(f"{API}/evaluations", json=SMALL | {"episodes": 1}, headers=headers)

    assert other.status_code == 422
    assert problem_of(other)["errors"][0]["field"] == "Idempotency-Key"
    assert len(here.get(f"{API}/evaluations").json()["items"]) == 1


def test_requests_without_a_key_make_one_each(here: TestClient) -> None:
    assert create(here)["id"] != create(here)["id"]


def test_cancelling_over_rest(here: TestClient) -> None:
    path = f"{API}/evaluations/{create(here)['id']}"

    answers = [here.post(f"{path}/cancellation") for _ in range(2)]

    assert [answer.status_code for answer in answers] == [202, 202]
    assert here.get(path).json()["state"] == "cancelled"
    refused = here.post(f"{path}/resumption")
    assert refused.status_code == 409 and problem_of(refused)["code"] == "not_incomplete"


def test_what_is_completed_is_not_cancelled(reader: TestClient) -> None:
    [evaluation] = reader.get(f"{API}/evaluations").json()["items"]

    answer = reader.post(f"{API}/evaluations/{evaluation['id']}/cancellation")

    assert answer.status_code == 409 and problem_of(answer)["code"] == "completed"


def test_resuming_over_rest(here: TestClient) -> None:
    path = f"{API}/evaluations/{create(here)['id']}"
    for _ in range(FAULTS):
        worker = Worker(hub_of(here), here)
        ended(hub_of(here), worker, "out of memory")
    assert here.get(path).json()["state"] == "incomplete"
    attempts = here.get(f"{path}/attempts").json()["items"]

    answer = here.post(f"{path}/resumption")

    assert (answer.status_code, answer.json()["state"]) == (202, "queued")
    assert [one["fence"] for one in attempts] == [3, 2, 1]
    assert {(one["state"], one["reason"]) for one in attempts} == {("lost", "out of memory")}


def test_what_waits_says_why(here: TestClient) -> None:
    create(here)

    assert create(here)["reason"] == "waits for a worker; 1 shard is before it"
    assert create(here, priority=1)["reason"] == "waits for a worker"


def test_a_restart_takes_back_what_was_handed_out(tmp_path: Path) -> None:
    with client(tmp_path) as here:
        id = create(here)["id"]
        worker = Worker(hub_of(here), here)
        worker.start(worker.episodes[0])
        worker.finish(worker.episodes[0])
        worker.start(worker.episodes[1])
        worker.record(worker.episodes[1], b"RRF2")
        (hub_of(here).folder.growing / "left.rrd").touch()

    with client(tmp_path) as here:
        stands = here.get(f"{API}/evaluations/{id}").json()
        attempts = here.get(f"{API}/evaluations/{id}/attempts").json()["items"]
        worker.client = here
        late = worker.finish(worker.episodes[1])

        assert (stands["state"], stands["progress"]["final"]) == ("running", 1)
        assert [(one["state"], one["reason"]) for one in attempts] == [
            ("lost", "the server stopped")
        ]
        assert late.status_code == 409
        assert list(hub_of(here).folder.growing.iterdir()) == []
