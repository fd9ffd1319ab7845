"""Policies over HTTP: registered, found, refused."""

from pathlib import Path

from tests.server.clients import API, SMALL, TestClient, client, create, problem_of


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
    found = reader.get(f"{API}/policies").json()["items"]

    assert {one["policy"] for one in found} == {"expert", "amnesiac", "random", "noop"}
    assert all(one["reference"] and one["version"] == 1 for one in found)


def test_python_is_refused_unless_allowed(here: TestClient, tmp_path: Path) -> None:
    policy = {
        "name": "mine",
        "spec": {"kind": "python", "target": "tests.workers.some_policies:Stays"},
    }

    refused = here.post(f"{API}/policies", json=policy)
    with client(tmp_path / "other", allow_python=True) as allowed:
        taken = allowed.post(f"{API}/policies", json=policy)

    assert refused.status_code == 403 and problem_of(refused)["code"] == "python_not_allowed"
    assert "--allow-python" in refused.json()["detail"]
    assert here.get(f"{API}/policies/mine").status_code == 404
    assert taken.status_code == 201, taken.text
    assert taken.json()["spec"]["timeout"] == 60.0


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


def test_policies_come_in_pages_the_newest_first(here: TestClient) -> None:
    policy = {"name": "mine", "spec": {"kind": "builtin", "name": "noop"}}
    made = [here.post(f"{API}/policies", json=policy).json()["id"] for _ in range(3)]

    found, cursor = [], None
    while True:
        query = {"limit": 2} | ({"cursor": cursor} if cursor else {})
        page = here.get(f"{API}/policies", params=query).json()
        found += [one["id"] for one in page["items"]]
        if (cursor := page["next"]) is None:
            break

    assert found[:3] == made[::-1]
    assert len(set(found)) == len(found) == 7  # and the built-in ones
