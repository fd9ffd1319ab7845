"""The API as a client meets it: wrong requests, and the life of an evaluation over HTTP."""

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from hide_tasks import ALL_TASKS
from hide_tasks.contract import Failure
from server import growing
from server.lifecycle import FAULTS
from server.models import Divergence
from server.routes import episodes as episode_routes
from tests.server import ledgers
from tests.server.clients import API, TestClient, Worker, client, hub_of, served, state_of
from workers.protocol import INTERNAL

SMALL = {"policy": "expert", "tasks": ["search_drawer"], "episodes": 2}
PROBLEM = "application/problem+json"


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A server with one completed evaluation, for requests that change nothing."""
    with client(tmp_path_factory.mktemp("api")) as found:
        hub = hub_of(found)
        ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=2)
        yield found


@pytest.fixture
def here(tmp_path: Path) -> Iterator[TestClient]:
    with client(tmp_path) as found:
        yield found


def create(here: httpx.Client, **wanted: Any) -> dict[str, Any]:
    answer = here.post(f"{API}/evaluations", json=SMALL | wanted)
    assert answer.status_code == 202, answer.text
    document: dict[str, Any] = answer.json()
    return document


def problem_of(answer: httpx.Response) -> dict[str, Any]:
    assert answer.headers["content-type"] == PROBLEM, answer.text
    document: dict[str, Any] = answer.json()
    assert document["status"] == answer.status_code
    assert document["detail"] and document["title"] and document["code"]
    return document


def events(answer: httpx.Response) -> list[tuple[str, str | None, dict[str, Any]]]:
    """Kind, number and payload of each server-sent event."""
    found = []
    for block in answer.text.replace("\r\n", "\n").strip().split("\n\n"):
        lines = [line.partition(": ")[::2] for line in block.split("\n") if line[0] != ":"]
        if fields := dict(lines):
            found.append((fields["event"], fields.get("id"), json.loads(fields["data"])))
    return found


# --- wrong requests ---

ID_ROUTES = [
    ("GET", "/tasks/{}"),
    ("GET", "/policies/{}"),
    ("GET", "/evaluations/{}"),
    ("GET", "/evaluations/{}/attempts"),
    ("GET", "/evaluations/{}/failures"),
    ("GET", "/evaluations/{}/episodes"),
    ("GET", "/evaluations/{}/events"),
    ("POST", "/evaluations/{}/cancellation"),
    ("POST", "/evaluations/{}/resumption"),
    ("GET", "/episodes/{}"),
    ("GET", "/episodes/{}/decisions"),
    ("GET", "/episodes/{}/changes"),
    ("GET", "/episodes/{}/spans"),
    ("GET", "/episodes/{}/thumbnail.jpg"),
    ("GET", "/episodes/{}/recording.rrd"),
]
OTHER_ROUTES = [
    ("GET", "/tasks"),
    ("GET", "/leaderboard"),
    ("GET", "/policies"),
    ("POST", "/policies"),
    ("GET", "/evaluations"),
    ("POST", "/evaluations"),
    ("POST", "/batches"),
    ("GET", "/episodes"),
    ("GET", "/health/live"),
    ("GET", "/health/ready"),
    ("GET", "/version"),
]
UNKNOWN = ["ev_01ARZ3NDEKTSV4RRFFQ69G5FAV", "x" * 500, "%00", "%F0%9F%92%A9", "%FF", "a'--", "-1"]


def test_every_route_is_tried(reader: TestClient) -> None:
    document = reader.get(f"{API}/openapi.json").json()
    described = {
        (method.upper(), path.removeprefix(API))
        for path, methods in document["paths"].items()
        for method in methods
    }
    tried = {(method, path.format("{}")) for method, path in ID_ROUTES + OTHER_ROUTES}

    parameters = ("task", "policy", "evaluation", "episode")
    for name in parameters:
        described = {(method, path.replace(f"{{{name}}}", "{}")) for method, path in described}
    assert described == tried


@pytest.mark.parametrize("unknown", UNKNOWN)
@pytest.mark.parametrize(("method", "path"), ID_ROUTES)
def test_an_unknown_id_is_not_found(
    reader: TestClient, method: str, path: str, unknown: str
) -> None:
    answer = reader.request(method, API + path.format(unknown))

    assert answer.status_code == 404
    assert problem_of(answer)["code"] == "not_found"


@pytest.mark.parametrize(("method", "path"), ID_ROUTES + OTHER_ROUTES)
def test_a_wrong_method_is_told_with_the_right_ones(
    reader: TestClient, method: str, path: str
) -> None:
    answer = reader.delete(API + path.format("x"))

    assert answer.status_code == 405
    assert method in answer.headers["allow"]
    assert problem_of(answer)["code"] == "method_not_allowed"


@pytest.mark.parametrize("path", ["/nowhere", API, f"{API}/", f"{API}/evaluation", f"{INTERNAL}/x"])
def test_an_unknown_path_is_not_found(reader: TestClient, path: str) -> None:
    assert problem_of(reader.get(path))["status"] == 404


@pytest.mark.parametrize("path", ["/evaluations", "/policies", "/batches"])
@pytest.mark.parametrize(
    "content", [b"", b"{", b"nothing", b"[]", b'"text"', b"null", b"1", b"\xff\xfe", b"{'a': 1}"]
)
def test_what_is_not_a_json_object_is_refused(
    reader: TestClient, path: str, content: bytes
) -> None:
    headers = {"Content-Type": "application/json"}

    answer = reader.post(API + path, content=content, headers=headers)

    assert answer.status_code == 422 or (content == b"\xff\xfe" and answer.status_code == 400)
    assert "body" in problem_of(answer)["detail"]


@pytest.mark.parametrize(
    ("path", "document", "field", "allowed"),
    [
        ("/evaluations", {}, "policy", "required"),
        ("/evaluations", {"policy": 3}, "policy", "string"),
        ("/evaluations", {"policy": ""}, "policy", "at least 1"),
        ("/evaluations", {"policy": "x" * 101}, "policy", "at most 100"),
        ("/evaluations", {"policy": "exprt"}, "policy", "did you mean expert?"),
        ("/evaluations", {"policy": "expert@2"}, "policy", "did you mean expert?"),
        ("/evaluations", SMALL | {"fast": True}, "fast", "not permitted"),
        ("/evaluations", SMALL | {"tasks": []}, "tasks", "at least 1"),
        ("/evaluations", SMALL | {"tasks": "search_drawer"}, "tasks", "list"),
        ("/evaluations", SMALL | {"tasks": ["serch_drawer"]}, "tasks", "Did you mean search_drawer"),
        ("/evaluations", SMALL | {"category": "HSR"}, "category", "excludes tasks"),
        ("/evaluations", {"policy": "expert", "category": "XX"}, "category", "'RC', 'HSR' or 'EPT'"),
        ("/evaluations", SMALL | {"split": "best"}, "split", "'train', 'val' or 'test'"),
        ("/evaluations", SMALL | {"episodes": 0}, "episodes", "greater than or equal to 1"),
        ("/evaluations", SMALL | {"episodes": 26}, "episodes", "test has 25 a task"),
        ("/evaluations", SMALL | {"episodes": 10**400}, "episodes", "test has 25 a task"),
        ("/evaluations", SMALL | {"episodes": "2"}, "episodes", "integer"),
        ("/evaluations", SMALL | {"episodes": 2.0}, "episodes", "integer"),
        ("/evaluations", SMALL | {"episodes": True}, "episodes", "integer"),
        ("/evaluations", SMALL | {"rules": "strict"}, "rules", "'hide' or 'parity'"),
        ("/evaluations", SMALL | {"priority": 101}, "priority", "less than or equal to 100"),
        ("/evaluations", SMALL | {"priority": "high"}, "priority", "integer"),
        ("/evaluations", SMALL | {"recordings": "yes"}, "recordings", "boolean"),
        ("/evaluations", SMALL | {"\ud800": 1}, "", "not permitted"),
        ("/evaluations", {"policy": "\ud800"}, "policy", ""),
        ("/policies", {}, "name", "required"),
        ("/policies", {"name": "mine"}, "spec", "required"),
        ("/policies", {"name": "mine", "spec": {}}, "spec", "'kind'"),
        ("/policies", {"name": "mine", "spec": {"kind": "magic"}}, "spec", "'builtin', 'python'"),
        ("/policies", {"name": "mine", "spec": {"kind": "builtin", "name": "best"}},
         "spec.builtin.name", "'expert', 'amnesiac', 'random' or 'noop'"),
        ("/policies", {"name": "a/b", "spec": {"kind": "builtin", "name": "noop"}}, "name", "pattern"),
        ("/policies", {"name": "x" * 81, "spec": {"kind": "builtin", "name": "noop"}}, "name",
         "pattern"),
        ("/policies", {"name": "mine", "description": "x" * 2001, "spec":
         {"kind": "builtin", "name": "noop"}}, "description", "at most 2000"),
        ("/policies", {"name": "expert", "spec": {"kind": "builtin", "name": "noop"}}, "name",
         "is a built-in policy"),
        ("/policies", {"name": "again", "spec": {"kind": "replay", "evaluation": "ev_x"}},
         "spec.evaluation", "no evaluation 'ev_x'"),
        ("/batches", {"items": [1]}, "items.0", "dictionary"),
        ("/batches", {"items": [{}] * 201}, "items", "at most 200"),
        ("/batches", {"matrix": {"policies": []}}, "matrix.policies", "at least 1"),
        ("/batches", {"matrix": {"policies": ["noop"], "fast": 1}}, "matrix.fast", "not permitted"),
        ("/batches", {"matrix": {"policies": ["noop"], "priority": "1"}}, "matrix.priority",
         "integer"),
    ],
)  # fmt: skip
def test_a_wrong_field_is_named_with_what_is_allowed(
    reader: TestClient, path: str, document: dict[str, Any], field: str, allowed: str
) -> None:
    before = reader.get(f"{API}/evaluations").json(), reader.get(f"{API}/policies").json()
    body = json.dumps(document)

    answer = reader.post(API + path, content=body, headers={"Content-Type": "application/json"})

    assert answer.status_code == 422
    named = {error["field"]: error["message"] for error in problem_of(answer)["errors"]}
    if field:
        assert field in named
    assert allowed in "; ".join(named.values())
    assert before == (reader.get(f"{API}/evaluations").json(), reader.get(f"{API}/policies").json())


@pytest.mark.parametrize(
    ("path", "query", "field"),
    [
        ("/leaderboard", {"split": "best"}, "split"),
        ("/leaderboard", {"verdict": "both"}, "verdict"),
        ("/evaluations", {"state": "asleep"}, "state"),
        ("/evaluations", {"limit": "0"}, "limit"),
        ("/evaluations", {"limit": "201"}, "limit"),
        ("/evaluations", {"limit": "many"}, "limit"),
        ("/evaluations", {"policy": "x" * 81}, "policy"),
        ("/evaluations", {"cursor": "x" * 501}, "cursor"),
        ("/evaluations", {"cursor": "nonsense"}, "cursor"),
        ("/evaluations", {"cursor": "é"}, "cursor"),
        ("/evaluations", {"cursor": "WzFd"}, "cursor"),  # [1]
        ("/evaluations", {"cursor": "W10"}, "cursor"),  # []
        ("/evaluations", {"cursor": "bnVsbA"}, "cursor"),  # null
        ("/evaluations", {"cursor": "WyJcdWQ4MDAiXQ"}, "cursor"),  # a lone surrogate
        ("/episodes", {"cursor": "WyJhIl0"}, "cursor"),  # of the list of evaluations
        ("/episodes", {"cursor": "WyJhIiwiYiIsdHJ1ZV0"}, "cursor"),  # ["a","b",true]
        ("/episodes", {"cursor": "WyJhIiwiYiIsMWUzMF0"}, "cursor"),  # ["a","b",1e30]
        ("/episodes", {"cursor": "WyJhIiwiYiIsMTAwMDAwMDAwMDAwMDAwMDAwMDAwMDAwMDAwMF0"}, "cursor"),
        ("/episodes", {"category": "XX"}, "category"),
        ("/episodes", {"failure": "sadness"}, "failure"),
        ("/episodes", {"success": "perhaps"}, "success"),
        ("/episodes", {"exact": "2"}, "exact"),
        ("/episodes", {"state": "done"}, "state"),
        ("/episodes", {"task": "x" * 81}, "task"),
        ("/episodes", {"evaluation": "x" * 81}, "evaluation"),
    ],
)
def test_a_wrong_query_is_named(
    reader: TestClient, path: str, query: dict[str, str], field: str
) -> None:
    answer = reader.get(API + path, params=query)

    assert answer.status_code == 422
    assert [error["field"] for error in problem_of(answer)["errors"]] == [field]


@pytest.mark.parametrize(
    ("query", "headers"),
    [
        ({"after": "-1"}, {}),
        ({"after": "all"}, {}),
        ({"after": str(10**30)}, {}),
        ({}, {"Last-Event-ID": "-1"}),
        ({}, {"Last-Event-ID": "first"}),
        ({}, {"Last-Event-ID": str(10**30)}),
    ],
)
def test_a_wrong_place_among_the_events_is_refused(
    reader: TestClient, query: dict[str, str], headers: dict[str, str]
) -> None:
    [evaluation] = reader.get(f"{API}/evaluations").json()["items"]
    path = f"{API}/evaluations/{evaluation['id']}/events"

    answer = reader.get(path, params=query, headers=headers)

    assert answer.status_code == 422
    assert problem_of(answer)["errors"][0]["field"] in ("after", "last-event-id", "last_event_id")


def test_queries_that_find_nothing_are_empty(reader: TestClient) -> None:
    for query in ({"task": "nothing"}, {"evaluation": "ev_x"}, {"policy": "\x00"}):
        assert reader.get(f"{API}/episodes", params=query).json() == {"items": [], "next": None}


# --- evaluations over REST ---


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
        ended(here, worker, "out of memory")
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


# --- policies ---


def test_versions_of_a_policy(here: TestClient) -> None:
    policy = {"name": "mine", "spec": {"kind": "builtin", "name": "noop"}}

    first, second = (here.post(f"{API}/policies", json=policy) for _ in range(2))

    assert [first.json()["version"], second.json()["version"]] == [1, 2]
    assert here.get(second.headers["location"]).json() == second.json()
    assert here.get(f"{API}/policies/mine").json() == second.json()
    assert here.get(f"{API}/policies/mine@1").json() == first.json()
    assert here.get(f"{API}/policies/mine@3").status_code == 404
    assert create(here, policy="mine@1")["version"] == 1
    assert create(here, policy=second.json()["id"])["version"] == 2


def test_the_built_in_policies_are_references(reader: TestClient) -> None:
    found = reader.get(f"{API}/policies").json()

    assert {one["policy"] for one in found} == {"expert", "amnesiac", "random", "noop"}
    assert all(one["reference"] and one["version"] == 1 for one in found)


def test_python_is_refused_unless_allowed(here: TestClient, tmp_path: Path) -> None:
    policy = {"name": "mine", "spec": {"kind": "python", "target": "mine:Policy"}}

    refused = here.post(f"{API}/policies", json=policy)
    with client(tmp_path / "other", allow_python=True) as allowed:
        taken = allowed.post(f"{API}/policies", json=policy)

    assert refused.status_code == 403 and problem_of(refused)["code"] == "python_not_allowed"
    assert "--allow-python" in refused.json()["detail"]
    assert here.get(f"{API}/policies/mine").status_code == 404
    assert taken.status_code == 201 and taken.json()["spec"]["timeout"] == 60.0


def test_a_replay_needs_final_episodes(reader: TestClient) -> None:
    [source] = [
        one for one in reader.get(f"{API}/evaluations").json()["items"] if one["policy"] == "expert"
    ]
    replay = {"name": "again", "spec": {"kind": "replay", "evaluation": source["id"]}}
    assert reader.post(f"{API}/policies", json=replay).status_code == 201

    more = reader.post(f"{API}/evaluations", json=SMALL | {"policy": "again", "episodes": 3})
    same = reader.post(f"{API}/evaluations", json=SMALL | {"policy": "again"})

    assert more.status_code == 422
    assert "no final search_drawer-test-002 to replay" in problem_of(more)["detail"]
    assert same.status_code == 202
    reader.post(f"{API}/evaluations/{same.json()['id']}/cancellation")


# --- events ---


def test_events_of_an_ended_evaluation_end(here: TestClient) -> None:
    hub = hub_of(here)
    id = ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=1)
    path = f"{API}/evaluations/{id}/events"

    answer = here.get(path)

    assert answer.headers["content-type"].startswith("text/event-stream")
    told = events(answer)
    numbered = [int(number) for _, number, _ in told if number]
    assert numbered == sorted(set(numbered))
    assert [kind for kind, number, _ in told if number] == [
        "evaluation", "evaluation", "episode", "episode", "attempt", "evaluation",
    ]  # fmt: skip
    assert told[-1][0] == "progress" and told[-1][2]["progress"]["final"] == 1
    last = here.get(f"{API}/evaluations/{id}").json()["last_event"]
    assert numbered[-1] == last

    after = [number for _, number, _ in events(here.get(path, params={"after": numbered[2]}))]
    resumed = events(here.get(path, headers={"Last-Event-ID": str(numbered[2])}))
    assert [int(one) for one in after if one] == numbered[3:]
    assert [int(number) for _, number, _ in resumed if number] == numbered[3:]


def test_a_follower_is_told_what_happens(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        id = create(here, episodes=1)["id"]
        lines: list[str] = []
        began = threading.Event()

        def follow() -> None:
            with here.stream("GET", f"{API}/evaluations/{id}/events") as answer:
                for line in answer.iter_lines():
                    lines.append(line)
                    began.set()

        thread = threading.Thread(target=follow)
        thread.start()
        assert began.wait(10)
        worker = Worker(hub, here)
        worker.start(worker.episodes[0])
        worker.finish(worker.episodes[0])
        ended(here, worker, None, hub)
        thread.join(timeout=10)

        assert not thread.is_alive(), "the stream did not end"
    told = [json.loads(line[6:]) for line in lines if line.startswith("data: ")]
    assert [one["state"] for one in told if "reason" in one and "fence" not in one] == [
        "queued", "running", "completed",
    ]  # fmt: skip


def test_followers_take_nothing_from_other_requests(tmp_path: Path) -> None:
    """More followers than the ledger has connections."""
    with served(tmp_path) as (_, here):
        id = create(here)["id"]
        limits = httpx.Limits(max_connections=50)
        with httpx.Client(base_url=here.base_url, limits=limits, trust_env=False) as many:
            open_ones = []
            for _ in range(20):
                request = many.build_request("GET", f"{API}/evaluations/{id}/events")
                open_ones.append(many.send(request, stream=True))
            began = time.monotonic()
            answers = [here.get(f"{API}/evaluations/{id}").status_code for _ in range(3)]
            cancelled = here.post(f"{API}/evaluations/{id}/cancellation")
            for one in open_ones:
                one.read()

    assert answers == [200] * 3 and cancelled.status_code == 202
    assert time.monotonic() - began < 10
    assert all("cancelled" in one.text for one in open_ones)


# --- what workers report ---


def ended(here: Any, worker: Worker, reason: str | None, hub: Any = None) -> None:
    """The engine says that an attempt is over."""
    from server import lifecycle
    from server.models import Attempt

    with (hub or hub_of(here)).database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, worker.attempt), reason)


def test_a_shard_is_played_over_http(here: TestClient) -> None:
    id = create(here)["id"]
    worker = Worker(hub_of(here), here)

    for number, episode in enumerate(worker.episodes):
        assert worker.start(episode).status_code == 204
        detail = here.get(f"{API}/episodes/{episode}").json()
        assert (detail["state"], detail["live"]) == ("running", True)
        stored = worker.record(episode, f"RRF2 {number}".encode()).json()
        what = ledgers.result_of(worker.specs[episode], Failure.OVERCOUNT if number else None)
        sent = what.model_copy(update={"recording": stored["sha256"]})
        assert worker.finish(episode, sent).json() == {"already": False}
        assert worker.finish(episode, sent).json() == {"already": True}
        detail = here.get(f"{API}/episodes/{episode}").json()
        assert (detail["state"], detail["live"]) == ("final", False)
        recording = here.get(detail["recording"])
        assert recording.content == f"RRF2 {number}".encode()
        assert recording.headers["content-type"] == "application/vnd.rerun.rrd"
        assert "immutable" in recording.headers["cache-control"]
        thumbnail = here.get(detail["thumbnail"])
        assert thumbnail.content == what.thumbnail
        assert thumbnail.headers["content-type"] == "image/jpeg"
    ended(here, worker, None)

    evaluation = here.get(f"{API}/evaluations/{id}").json()
    assert evaluation["state"] == "completed"
    assert evaluation["verdicts"]["success"]["successes"] == 2
    assert evaluation["verdicts"]["exact"]["successes"] == 1
    groups = here.get(f"{API}/evaluations/{id}/failures").json()
    assert [(one["failure"], one["episodes"]) for one in groups] == [("overcount", 1)]


def test_recordings_are_served_in_ranges(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    sha256 = worker.record(episode, b"0123456789").json()["sha256"]
    what = ledgers.result_of(worker.specs[episode])
    worker.finish(episode, what.model_copy(update={"recording": sha256}))

    part = here.get(f"{API}/episodes/{episode}/recording.rrd", headers={"Range": "bytes=2-4"})

    assert (part.status_code, part.content) == (206, b"234")


def test_episodes_without_files_have_none(here: TestClient) -> None:
    create(here, recordings=False)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)

    detail = here.get(f"{API}/episodes/{episode}").json()
    assert (detail["recording"], detail["thumbnail"], detail["live"]) == (None, None, False)
    for file in ("recording.rrd", "thumbnail.jpg"):
        assert here.get(f"{API}/episodes/{episode}/{file}").status_code == 404


def test_a_running_episode_without_a_recording_is_not_waited_for_long(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(episode_routes, "PATIENCE", 0.2)
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])

    answer = here.get(f"{API}/episodes/{worker.episodes[0]}/recording.rrd")

    assert answer.status_code == 404


def test_a_recording_is_watched_while_it_grows(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        create(here)
        worker = Worker(hub, here)
        episode = worker.episodes[0]
        worker.start(episode)
        seen: list[bytes] = []
        first, second = threading.Event(), threading.Event()

        def watch() -> None:
            with here.stream("GET", f"{API}/episodes/{episode}/recording.rrd") as answer:
                for piece in answer.iter_raw():
                    seen.append(piece)
                    first.set()
                    if b"more" in b"".join(seen):
                        second.set()

        def pieces() -> Iterator[bytes]:
            yield b"RRF2 "
            assert first.wait(10), "the first piece did not arrive while the recording grew"
            yield b"and more"
            assert second.wait(10)

        thread = threading.Thread(target=watch)
        thread.start()
        stored = worker.record(episode, pieces())
        thread.join(timeout=10)

        assert stored.status_code == 200
        assert b"".join(seen) == b"RRF2 and more"
        late = here.get(f"{API}/episodes/{episode}/recording.rrd")  # there, but not final yet
        assert (late.status_code, late.content) == (200, b"RRF2 and more")
        assert late.headers["cache-control"] == "no-store"
        assert list(hub.folder.growing.iterdir()) == []


def test_too_large_a_recording_over_http(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growing, "MOST", 10)
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])

    answer = worker.record(worker.episodes[0], b"x" * 11)

    assert answer.status_code == 400 and problem_of(answer)["code"] == "broken_off"
    assert list(hub_of(here).folder.growing.iterdir()) == []


def test_a_recording_whose_attempt_ends_meanwhile_is_stale(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        create(here)
        worker = Worker(hub, here)
        episode = worker.episodes[0]
        worker.start(episode)

        def pieces() -> Iterator[bytes]:
            yield b"RRF2"
            while not (found := hub.recordings.get(episode)) or not found.size:
                time.sleep(0.01)
            ended(here, worker, "it hung", hub)
            hub.recordings.forget(episode)
            yield b" and more"

        answer = worker.record(episode, pieces())

        assert answer.status_code == 409 and problem_of(answer)["code"] == "stale_attempt"
        assert list(hub.folder.growing.iterdir()) == []


def test_a_fault_puts_an_episode_back(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    worker.record(episode, b"RRF2")

    assert worker.fault(episode).status_code == 204
    assert state_of(hub_of(here), episode) == "pending"
    assert hub_of(here).recordings.get(episode) is None
    assert worker.fault(episode, "x" * 2001).status_code == 422


def test_two_results_of_an_episode_are_an_alarm(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    worker.finish(episode)

    other = ledgers.result_of(worker.specs[episode], Failure.OVERCOUNT)
    answer = worker.finish(episode, other)

    assert answer.status_code == 409 and problem_of(answer)["code"] == "diverged"
    assert here.get(f"{API}/episodes/{episode}").json()["exact"] is True
    with hub_of(here).database.reading() as session:
        assert session.scalar(select(func.count()).select_from(Divergence)) == 1


REPORTS = ["start", "recording", "result", "fault"]


def report(worker: Worker, what: str, episode: str) -> httpx.Response:
    if what == "start":
        return worker.start(episode)
    if what == "recording":
        return worker.record(episode, b"RRF2")
    if what == "result":
        return worker.finish(episode, ledgers.result_of(worker.specs[worker.episodes[0]]))
    return worker.fault(episode)


@pytest.mark.parametrize("what", REPORTS)
@pytest.mark.parametrize(
    "header", ["", "Bearer", "Bearer ", "Bearer wrong", "Basic dXNlcjpwdw==", "bearer é"]
)
def test_a_report_needs_its_attempts_token(here: TestClient, what: str, header: str) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    worker.headers = {"Authorization": header.encode("latin-1")} if header else {}  # type: ignore[dict-item]

    answer = report(worker, what, worker.episodes[0])

    assert answer.status_code == 401
    assert problem_of(answer)["code"] in ("no_token", "wrong_token")
    assert state_of(hub_of(here), worker.episodes[0]) == "pending"


@pytest.mark.parametrize("what", REPORTS)
def test_another_attempts_token_opens_nothing(here: TestClient, what: str) -> None:
    create(here, episodes=10)
    worker, other = (Worker(hub_of(here), here) for _ in range(2))
    worker.headers = other.headers

    assert report(worker, what, worker.episodes[0]).status_code == 401


@pytest.mark.parametrize("what", REPORTS)
def test_an_attempt_reports_only_its_own_episodes(here: TestClient, what: str) -> None:
    create(here, episodes=10)
    worker, other = (Worker(hub_of(here), here) for _ in range(2))
    worker.start(worker.episodes[0])

    assert report(worker, what, other.episodes[0]).status_code == 404
    assert report(worker, what, "ep_x").status_code == 404


@pytest.mark.parametrize("what", REPORTS)
def test_an_ended_attempt_is_stale(here: TestClient, what: str) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])
    ended(here, worker, "it hung")

    answer = report(worker, what, worker.episodes[0])

    assert answer.status_code == 409 and problem_of(answer)["code"] == "stale_attempt"


@pytest.mark.parametrize("what", ["recording", "result"])
def test_what_was_not_begun_is_not_reported(here: TestClient, what: str) -> None:
    create(here)
    worker = Worker(hub_of(here), here)

    assert report(worker, what, worker.episodes[0]).status_code == 409


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b'{"digest": 1}', b'{"fast": 1}'])
def test_a_report_that_is_none_is_refused(here: TestClient, content: bytes) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])
    path = worker.path(worker.episodes[0], "result")
    headers = worker.headers | {"Content-Type": "application/json"}

    answer = here.put(path, content=content, headers=headers)

    assert answer.status_code == 422
    assert problem_of(answer)["errors"]
    assert state_of(hub_of(here), worker.episodes[0]) == "running"


# --- health ---


def test_health(here: TestClient) -> None:
    create(here)
    Worker(hub_of(here), here)
    create(here)

    assert here.get(f"{API}/health/live").json() == {"status": "ok"}
    ready = here.get(f"{API}/health/ready")
    assert ready.status_code == 200
    assert ready.json() == {
        "status": "ok", "checks": {"ledger": "ok", "disk": "ok"}, "workers": 0, "running": 1,
        "queued": 1,
    }  # fmt: skip
    assert here.get(f"{API}/version").json()["suite"] == "hide 1"


def test_a_full_disk_is_told(here: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    from server import hub

    monkeypatch.setattr(hub, "RESERVE", 2**62)

    answer = here.get(f"{API}/health/ready")

    assert answer.status_code == 503
    assert answer.json()["status"] == "degraded"
    assert answer.json()["checks"]["disk"].startswith("full")


# --- restarts ---


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
        assert [(one["state"], one["reason"]) for one in attempts] == [("lost", "the server stopped")]
        assert late.status_code == 409
        assert list(hub_of(here).folder.growing.iterdir()) == []
