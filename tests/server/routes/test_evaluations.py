"""Evaluations over HTTP: asked for, stopped, resumed, many at once."""

from pathlib import Path

from hide_tasks import ALL_TASKS
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

    assert sorted(created["tasks"]) == sorted(ALL_TASKS)
    assert created["progress"]["expected"] == 25 * len(ALL_TASKS)


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
    attempts = here.get(f"{path}/attempts").json()

    answer = here.post(f"{path}/resumption")

    assert (answer.status_code, answer.json()["state"]) == (202, "queued")
    assert [one["fence"] for one in attempts] == [3, 2, 1]
    assert {(one["state"], one["reason"]) for one in attempts} == {("lost", "out of memory")}


def test_what_waits_says_why(here: TestClient) -> None:
    create(here)

    assert create(here)["reason"] == "waits for a worker; 1 shards of others are before it"
    assert create(here, priority=1)["reason"] == "waits for a worker"


def test_a_batch_tells_of_every_item(here: TestClient) -> None:
    items = [SMALL, {"policy": "nobody"}, {"policy": "noop", "episodes": "all"}, {}, SMALL]

    answer = here.post(f"{API}/batches", json={"items": items})

    found = answer.json()["items"]
    assert answer.status_code == 202
    assert [one["status"] for one in found] == [202, 422, 422, 422, 202]
    assert found[1]["problem"]["errors"][0]["field"] == "policy"
    assert found[2]["problem"]["errors"][0]["field"] == "episodes"
    assert found[3]["problem"]["errors"][0]["field"] == "policy"
    there = [one["id"] for one in here.get(f"{API}/evaluations").json()["items"]]
    assert there == [found[4]["evaluation"]["id"], found[0]["evaluation"]["id"]]


def test_a_matrix_gives_every_policy_the_same(here: TestClient) -> None:
    matrix = {"policies": ["expert", "nobody", "noop"], "tasks": ["search_drawer"], "episodes": 1}

    found = here.post(f"{API}/batches", json={"matrix": matrix}).json()["items"]

    assert [one["status"] for one in found] == [202, 422, 202]
    assert [found[n]["evaluation"]["policy"] for n in (0, 2)] == ["expert", "noop"]
    assert all(found[n]["evaluation"]["episodes"] == 1 for n in (0, 2))


def test_an_empty_batch_is_refused(here: TestClient) -> None:
    answer = here.post(f"{API}/batches", json={})

    assert answer.status_code == 422
    assert "list evaluations, or give a matrix" in problem_of(answer)["detail"]


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
        attempts = here.get(f"{API}/evaluations/{id}/attempts").json()
        worker.client = here
        late = worker.finish(worker.episodes[1])

        assert (stands["state"], stands["progress"]["final"]) == ("running", 1)
        assert [(one["state"], one["reason"]) for one in attempts] == [
            ("lost", "the server stopped")
        ]
        assert late.status_code == 409
        assert list(hub_of(here).folder.growing.iterdir()) == []


def test_a_batch_with_a_name_that_is_no_text_still_tells_of_its_other_items(
    here: TestClient,
) -> None:
    content = b'{"items": [{"policy": "noop", "episodes": 1}, {"\\ud800": 1}]}'

    answer = here.post(
        f"{API}/batches", content=content, headers={"Content-Type": "application/json"}
    )

    assert answer.status_code == 202
    assert [item["status"] for item in answer.json()["items"]] == [202, 422]
