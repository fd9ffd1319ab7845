"""Whatever is wrong with a request is answered with a problem that says what, and what is right."""

import json
from typing import Any

import pytest

from tests.server.clients import (
    API,
    SMALL,
    TestClient,
    problem_of,
)
from workers.protocol import INTERNAL

ID_ROUTES = [
    ("GET", "/tasks/{}"),
    ("GET", "/policies/{}"),
    ("GET", "/evaluations/{}"),
    ("GET", "/evaluations/{}/attempts"),
    ("GET", "/evaluations/{}/failures"),
    ("GET", "/evaluations/{}/episodes"),
    ("GET", "/evaluations/{}/export"),
    ("GET", "/evaluations/{}/events"),
    ("POST", "/evaluations/{}/cancellation"),
    ("POST", "/evaluations/{}/resumption"),
    ("GET", "/evaluations/{}/queue"),
    ("GET", "/evaluations/{}/history"),
    ("GET", "/evaluations/{}/log"),
    ("POST", "/evaluations/{}/rerun"),
    ("GET", "/evaluations/{}/publication"),
    ("POST", "/evaluations/{}/publication"),
    ("GET", "/batches/{}"),
    ("GET", "/leaderboard/snapshots/{}"),
    ("GET", "/leaderboard/snapshots/{}/content.json"),
    ("POST", "/labels/{}/withdrawal"),
    ("GET", "/tokens/{}"),
    ("POST", "/tokens/{}/revocation"),
    ("GET", "/users/{}"),
    ("GET", "/webhooks/{}"),
    ("DELETE", "/webhooks/{}"),
    ("POST", "/webhooks/{}/secret"),
    ("POST", "/webhooks/{}/trial"),
    ("GET", "/webhooks/{}/deliveries"),
    ("POST", "/webhooks/{}/deliveries/{}/repetition"),
    ("GET", "/episodes/{}"),
    ("GET", "/episodes/{}/decisions"),
    ("GET", "/episodes/{}/changes"),
    ("GET", "/episodes/{}/spans"),
    ("GET", "/episodes/{}/labels"),
    ("GET", "/episodes/{}/parting"),
    ("GET", "/episodes/{}/runs"),
    ("GET", "/episodes/{}/preview.webp"),
    ("GET", "/episodes/{}/observations/0/front.jpg"),
    ("GET", "/episodes/{}/thumbnail.jpg"),
    ("GET", "/episodes/{}/recording.rrd"),
    ("GET", "/episodes/{}/beliefs"),
    ("GET", "/episodes/{}/actions.json"),
    ("GET", "/episodes/{}/rerun"),
]
OTHER_ROUTES = [
    ("GET", "/tasks"),
    ("GET", "/leaderboard"),
    ("GET", "/leaderboard/published"),
    ("GET", "/leaderboard/snapshots"),
    ("POST", "/leaderboard/snapshots"),
    ("GET", "/comparisons"),
    ("GET", "/comparisons/several"),
    ("GET", "/comparisons/several/export"),
    ("GET", "/ablations"),
    ("GET", "/ablations/export"),
    ("GET", "/queue"),
    ("GET", "/workers"),
    ("GET", "/workers/log"),
    ("GET", "/labels"),
    ("POST", "/episodes/{}/labels"),
    ("GET", "/leaderboard/export"),
    ("GET", "/policies"),
    ("POST", "/policies"),
    ("POST", "/policies/checkpoints"),
    ("GET", "/evaluations"),
    ("GET", "/evaluations/estimate"),
    ("POST", "/policies/connection"),
    ("POST", "/evaluations"),
    ("GET", "/batches"),
    ("POST", "/batches"),
    ("GET", "/episodes"),
    ("GET", "/episodes/facets"),
    ("GET", "/episodes/export"),
    ("GET", "/me"),
    ("GET", "/tokens"),
    ("POST", "/tokens"),
    ("GET", "/users"),
    ("POST", "/users"),
    ("POST", "/users/{}/changes"),
    ("GET", "/audit"),
    ("GET", "/webhooks"),
    ("POST", "/webhooks"),
    ("POST", "/webhooks/{}/changes"),
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
        if not path.startswith(f"{API}/uploads")  # routes/test_uploads.py has these
    }
    tried = set(ID_ROUTES + OTHER_ROUTES)

    parameters = ("task", "policy", "evaluation", "episode", "token", "user", "webhook", "delivery")
    parameters += ("batch", "snapshot", "label")
    for name in parameters:
        described = {(method, path.replace(f"{{{name}}}", "{}")) for method, path in described}
    picture = "/episodes/{}/observations/{decision}/{camera}.jpg"
    described = {
        (method, path.replace(picture, "/episodes/{}/observations/0/front.jpg"))
        for method, path in described
    }
    assert described == tried


@pytest.mark.parametrize("unknown", UNKNOWN)
@pytest.mark.parametrize(("method", "path"), ID_ROUTES)
def test_an_unknown_id_is_not_found(
    reader: TestClient, method: str, path: str, unknown: str
) -> None:
    answer = reader.request(method, API + path.replace("{}", unknown))

    assert answer.status_code == 404
    assert problem_of(answer)["code"] == "not_found"


@pytest.mark.parametrize(("method", "path"), ID_ROUTES + OTHER_ROUTES)
def test_a_wrong_method_is_told_with_a_right_one(
    reader: TestClient, method: str, path: str
) -> None:
    answer = reader.request(
        "DELETE" if method == "POST" else "PATCH", API + path.replace("{}", "x")
    )

    assert answer.status_code == 405
    assert set(answer.headers["allow"].split(", ")) <= {"GET", "POST"}
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
        ("/evaluations", SMALL | {"tasks": []}, "tasks", "choose at least one task"),
        ("/evaluations", SMALL | {"tasks": "search_drawer"}, "tasks", "list"),
        ("/evaluations", SMALL | {"tasks": ["serch_drawer"]}, "tasks", "search_drawer?"),
        ("/evaluations", SMALL | {"category": "HSR"}, "category", "excludes tasks"),
        ("/evaluations", {"policy": "noop", "category": "XX"}, "category", "'RC', 'HSR' or 'EPT'"),
        ("/evaluations", SMALL | {"split": "best"}, "split", "'test' or 'test100'"),
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
        ("/evaluations", SMALL | {"\ud800": 1}, "body", "unicode"),
        ("/evaluations", {"policy": "\ud800"}, "policy", "unicode"),
        ("/policies", {}, "name", "required"),
        ("/policies", {"name": "mine"}, "spec", "required"),
        ("/policies", {"name": "mine", "spec": {}}, "spec", "'kind'"),
        ("/policies", {"name": "mine", "spec": {"kind": "magic"}}, "spec", "'builtin', 'python'"),
        ("/policies", {"name": "mine", "spec": {"kind": "builtin", "name": "best"}},
         "spec.builtin.name", "'expert', 'amnesiac', 'random' or 'noop'"),
        ("/policies", {"name": "a/b", "spec": {"kind": "builtin", "name": "noop"}}, "name",
         "pattern"),
        ("/policies", {"name": "x" * 81, "spec": {"kind": "builtin", "name": "noop"}}, "name",
         "pattern"),
        ("/policies", {"name": "mine", "description": "x" * 2001, "spec":
         {"kind": "builtin", "name": "noop"}}, "description", "at most 2000"),
        ("/policies", {"name": "expert", "spec": {"kind": "builtin", "name": "noop"}}, "name",
         "is a built-in policy"),
        ("/policies", {"name": "again", "spec": {"kind": "replay", "evaluation": "ev_x"}},
         "spec.evaluation", "no evaluation 'ev_x'"),
        ("/tokens", {"name": "x", "scopes": []}, "scopes", "at least 1"),
        ("/tokens", {"name": "x", "scopes": ["all"]}, "scopes.0", "'read', 'submit'"),
        ("/tokens", {"name": "x", "scopes": ["read"], "expires": "2020-01-01T00:00:00Z"},
         "expires", "is past"),
        ("/tokens", {"name": "x", "scopes": ["read"], "expires": "2090-01-01T00:00:00"},
         "expires", "timezone"),
        ("/users", {"name": "a b", "role": "viewer"}, "name", "pattern"),
        ("/users", {"name": "ann", "role": "god"}, "role", "'viewer', 'submitter'"),
        ("/users", {"name": "owner", "role": "viewer"}, "name", "is taken"),
        ("/users", {"name": "ann", "role": "viewer", "password": "short"}, "password", "10 to 200"),
        ("/evaluations", {"policy": "noop", "suite": "quick"}, "suite", "'smoke', 'RC'"),
        ("/evaluations", SMALL | {"suite": "full"}, "tasks", "is chosen by suite 'full'"),
        ("/evaluations", {"policy": "noop", "suite": "RC", "category": "RC"}, "category",
         "is chosen by suite 'RC'"),
        ("/evaluations", {"policy": "noop", "suite": "smoke", "episodes": 3}, "episodes",
         "is chosen by suite 'smoke'"),
        ("/leaderboard/snapshots", {"split": "best"}, "split", "'test' or 'test100'"),
        ("/leaderboard/snapshots", {"suite": "full"}, "suite", "hide, hide-hard, real4"),
        ("/leaderboard/snapshots", {"note": "x" * 2001}, "note", "at most 2000"),
        ("/batches", {"matrix": {"policies": ["noop"], "suites": []}}, "matrix.suites",
         "at least 1"),
        ("/batches", {"matrix": {"policies": ["noop"], "suites": ["all"]}}, "matrix.suites.0",
         "'smoke', 'RC'"),
        ("/webhooks", {}, "url", "required"),
        ("/webhooks", {"url": "https://example.org", "events": []}, "events", "at least 1"),
        ("/webhooks", {"url": "https://example.org", "events": ["all"]}, "events.0",
         "'evaluation.queued'"),
        ("/webhooks", {"url": "http://example.org"}, "url", "is not encrypted"),
        ("/webhooks", {"url": "https://10.0.0.1"}, "url", "is not a public address"),
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
    assert field in named
    assert allowed in "; ".join(named.values())
    assert before == (reader.get(f"{API}/evaluations").json(), reader.get(f"{API}/policies").json())


@pytest.mark.parametrize(
    ("path", "query", "field"),
    [
        ("/leaderboard", {"split": "best"}, "split"),
        ("/leaderboard", {"suite": "best"}, "suite"),
        ("/leaderboard/export", {"suite": "real4", "format": "latex"}, "format"),
        ("/leaderboard", {"verdict": "both"}, "verdict"),
        ("/leaderboard", {"sort": "beauty"}, "sort"),
        ("/leaderboard", {"order": "up"}, "order"),
        ("/leaderboard", {"category": "XX"}, "category"),
        ("/leaderboard", {"clock": "maybe"}, "clock"),
        ("/leaderboard", {"privileged": "no"}, "privileged"),
        ("/leaderboard", {"since": "yesterday"}, "since"),
        ("/leaderboard", {"search": "x" * 81}, "search"),
        ("/leaderboard/export", {"table": "perhaps"}, "table"),
        ("/comparisons", {"a": "expert"}, "b"),
        ("/comparisons", {"a": "nobody", "b": "expert"}, "a"),
        ("/comparisons", {"a": "noop", "b": "expert"}, "a"),  # has nothing completed
        ("/comparisons", {"a": "expert", "b": "expert", "split": "best"}, "split"),
        ("/comparisons", {"a": "expert", "b": "expert", "suite": "best"}, "suite"),
        ("/comparisons", {"a": "expert", "b": "expert", "suite": "real4"}, "a"),
        ("/comparisons/several", {"policy": "expert"}, "policy"),
        ("/comparisons/several", {"policy": ["expert"] * 7}, "policy"),
        ("/comparisons/several", {"policy": ["expert", "exprt"]}, "policy.1"),
        ("/comparisons/several", {"policy": ["expert", "x" * 101]}, "policy"),
        ("/comparisons/several", {"policy": ["expert", ""]}, "policy"),
        ("/comparisons/several", {"policy": ["noop", "expert"]}, "policy.0"),
        ("/comparisons/several", {"policy": ["a", "b"], "verdict": "x"}, "verdict"),
        ("/comparisons/several", {"policy": ["a", "b"], "suite": ""}, "suite"),
        ("/comparisons/several/export", {"policy": ["a", "b"], "suite": "full"}, "suite"),
        ("/ablations", {"size": "large"}, "size"),
        ("/ablations", {"clock": "late"}, "clock"),
        ("/ablations/export", {"format": "zip"}, "format"),
        ("/comparisons/several/export", {"policy": ["a", "b"], "format": "zip"}, "format"),
        ("/leaderboard/snapshots", {"suite": "best"}, "suite"),
        ("/leaderboard/snapshots", {"cursor": "WyJhIl0"}, "cursor"),  # ["a"]
        ("/policies", {"cursor": "WzFd"}, "cursor"),
        ("/users", {"limit": "0"}, "limit"),
        ("/tokens", {"cursor": "nonsense"}, "cursor"),
        ("/queue", {"limit": "0"}, "limit"),
        ("/leaderboard/export", {"format": "zip"}, "format"),
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
        ("/episodes", {"label": "x" * 81}, "label"),
        ("/episodes", {"evaluation": "x" * 81}, "evaluation"),
        ("/episodes", {"hidden": "presses_done"}, "hidden"),
        ("/episodes", {"hidden": "=3"}, "hidden"),
        ("/episodes", {"variation": "count"}, "variation"),
        ("/episodes", {"text": "x" * 201}, "text"),
        ("/episodes", {"text": "a\x00b"}, "text"),
        ("/episodes", {"sort": "best"}, "sort"),
        ("/episodes", {"verdict": "bad"}, "verdict"),
        ("/episodes/facets", {"task": "serch_drawer"}, "task"),
        ("/episodes/facets", {"variation": "colour=red"}, "variation"),
        ("/episodes/facets", {"task": "search_drawer", "variation": "count=3"}, "variation"),
        ("/episodes/export", {"format": "zip"}, "format"),
        ("/episodes/export", {"task": "serch_drawer"}, "task"),
    ],
)
def test_a_wrong_query_is_named(
    reader: TestClient, path: str, query: dict[str, Any], field: str
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
