"""Batches over HTTP: many evaluations at once, kept, and asked for twice."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hide_tasks import SUITES
from server import batches
from server.problems import Problem
from tests.server.clients import API, SMALL, TestClient, client, hub_of, problem_of


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


def test_a_batch_with_a_name_that_is_no_text_still_tells_of_its_other_items(
    here: TestClient,
) -> None:
    content = b'{"items": [{"policy": "noop", "episodes": 1}, {"\\ud800": 1}]}'

    answer = here.post(
        f"{API}/batches", content=content, headers={"Content-Type": "application/json"}
    )

    assert answer.status_code == 202
    assert [item["status"] for item in answer.json()["items"]] == [202, 422]


def test_a_matrix_of_policies_and_suites(here: TestClient) -> None:
    matrix = {"policies": ["expert", "noop"], "suites": ["smoke", "RC"], "recordings": False}

    found = here.post(f"{API}/batches", json={"matrix": matrix}).json()

    made = [one["evaluation"] for one in found["items"]]
    assert [(one["policy"], one["covers"]) for one in made] == [
        ("expert", "smoke"), ("noop", "smoke"), ("expert", "RC"), ("noop", "RC"),
    ]  # fmt: skip
    assert [(one["split"], one["episodes"]) for one in made[1:3]] == [("val", 1), ("test", 25)]
    assert not any(one["recordings"] for one in made)


def test_suites_exclude_what_they_choose(here: TestClient) -> None:
    matrix = {"policies": ["noop"], "suites": ["smoke", "full"], "tasks": ["search_drawer"]}

    found = here.post(f"{API}/batches", json={"matrix": matrix}).json()["items"]

    assert [one["status"] for one in found] == [422, 422]
    assert "is chosen by suite 'smoke'" in found[0]["problem"]["errors"][0]["message"]


def test_more_than_two_hundred_are_refused_whole(here: TestClient) -> None:
    matrix = {"policies": ["noop"] * 101, "suites": ["smoke", "RC"]}

    answer = here.post(f"{API}/batches", json={"matrix": matrix})

    assert answer.status_code == 422
    assert "202 evaluations; at most 200" in problem_of(answer)["detail"]
    assert here.get(f"{API}/evaluations").json()["items"] == []


def test_a_batch_is_where_its_location_says(here: TestClient) -> None:
    answer = here.post(f"{API}/batches", json={"items": [SMALL, {"policy": "nobody"}]})

    kept = here.get(answer.headers["location"]).json()
    [listed] = here.get(f"{API}/batches").json()["items"]
    assert kept == answer.json()
    assert (listed["expected"], listed["accepted"], listed["refused"]) == (2, 1, 1)
    assert listed["owner"] == "owner" and listed["id"] == kept["id"]


def test_batches_come_in_pages(here: TestClient) -> None:
    made = [here.post(f"{API}/batches", json={"items": [{}]}).json()["id"] for _ in range(3)]

    first = here.get(f"{API}/batches", params={"limit": 2}).json()
    second = here.get(f"{API}/batches", params={"limit": 2, "cursor": first["next"]}).json()

    found = [one["id"] for page in (first, second) for one in page["items"]]
    assert found == made[::-1] and second["next"] is None


def test_the_same_key_and_batch_again_make_nothing_more(here: TestClient) -> None:
    headers = {"Idempotency-Key": "monday"}
    document = {"items": [SMALL, {"policy": "nobody"}, SMALL]}

    first, again = (here.post(f"{API}/batches", json=document, headers=headers) for _ in range(2))

    assert first.json() == again.json()
    assert len(here.get(f"{API}/evaluations").json()["items"]) == 2


def test_the_same_key_and_another_batch_are_refused(here: TestClient) -> None:
    headers = {"Idempotency-Key": "monday"}
    here.post(f"{API}/batches", json={"items": [SMALL]}, headers=headers)

    other = here.post(f"{API}/batches", json={"items": [SMALL, SMALL]}, headers=headers)

    assert other.status_code == 422
    assert problem_of(other)["errors"][0]["field"] == "Idempotency-Key"
    assert len(here.get(f"{API}/evaluations").json()["items"]) == 1


def test_a_batch_asked_for_several_times_at_once_is_made_once(here: TestClient) -> None:
    def ask(_: int) -> dict[str, object]:
        document = {"items": [SMALL, {"policy": "nobody"}] * 3}
        answer = here.post(f"{API}/batches", json=document, headers={"Idempotency-Key": "at once"})
        found: dict[str, object] = answer.json()
        return found

    with ThreadPoolExecutor(4) as pool:
        ids = {str(found["id"]) for found in pool.map(ask, range(4))}

    kept = here.get(f"{API}/batches/{ids.pop()}").json()
    assert not ids
    assert [one["status"] for one in kept["items"]] == [202, 422] * 3
    assert len(here.get(f"{API}/evaluations").json()["items"]) == 3


def test_a_batch_that_broke_off_goes_on_where_it_was(tmp_path: Path) -> None:
    document = {"items": [SMALL, SMALL, SMALL]}
    headers = {"Idempotency-Key": "cut"}
    with client(tmp_path) as here:
        hub = hub_of(here)
        with hub.database.writing() as session:  # what a server that was killed then left
            batch = batches.begun(session, document["items"], "cut", hub.owner_id)
            batches.refuse(batch, Problem(429, "quota_attempts", "Used up."))

    with client(tmp_path) as here:
        kept = here.post(f"{API}/batches", json=document, headers=headers).json()

        assert kept["id"] == batch.id
        assert [one["status"] for one in kept["items"]] == [429, 202, 202]


@pytest.mark.parametrize(
    ("name", "tasks", "episodes"), [("smoke", 3, 1), ("full", len(SUITES["hide"]), 25)]
)
def test_an_evaluation_of_a_suite(here: TestClient, name: str, tasks: int, episodes: int) -> None:
    made = here.post(f"{API}/evaluations", json={"policy": "noop", "suite": name}).json()

    assert (made["covers"], len(made["tasks"]), made["episodes"]) == (name, tasks, episodes)
    assert made["split"] == ("val" if name == "smoke" else "test")


def test_what_is_no_suite_covers_a_part(here: TestClient) -> None:
    made = here.post(f"{API}/evaluations", json=SMALL).json()

    assert made["covers"] == "part"
