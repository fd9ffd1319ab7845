"""A policy's server is tried before it is registered, and says what is wrong."""

import socket
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from server.app import THREADS
from tests.server.clients import API, TestClient, client, problem_of
from tests.workers.remote.peers import JOINTS, STATE, answering, raw
from workers.policies import BadPolicy, Remote
from workers.remote import trial
from workers.remote.maps import Declaration, everything

OURS = Declaration(model="mine", observation=everything(), max_sessions=3).message()
ACTION = {"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0, 1, 0, 0]}


@pytest.fixture
def near(tmp_path: Path) -> Iterator[TestClient]:
    """A server that may connect to this machine."""
    with client(tmp_path / "near", allow_remote=["127.0.0.1"]) as here:
        yield here


def tried(here: TestClient, url: str, **spec: Any) -> dict[str, Any]:
    answer = here.post(
        f"{API}/policies/connection", json={"spec": {"kind": "remote", "url": url} | spec}
    )
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def answer_ours(message: dict[Any, Any]) -> dict[str, Any]:
    if message["endpoint"] == "reset":
        return {"ok": True}
    return {"request_id": message["request_id"], "action": ACTION}


def test_a_server_says_what_it_is_and_decides(near: TestClient) -> None:
    with answering(answer_ours, OURS) as url:
        found = tried(near, url)

    assert found["fits"]
    about = found["about"]
    assert (about["dialect"], about["model"], about["sessions"]) == ("hide", "mine", 3)
    assert "front/rgb" in about["sees"] and about["acts"] == "action"
    steps = [(one["name"], one["outcome"]) for one in found["steps"]]
    assert steps == [("address", "passed"), ("connection", "passed"), ("decision", "passed")]
    assert "keyframe at (0.30, 0.00, 0.90)" in found["steps"][2]["detail"]
    assert found["steps"][1]["seconds"] < 5
    assert {one["policy"] for one in near.get(f"{API}/policies").json()["items"]} == {
        "expert", "amnesiac", "random", "noop"
    }  # fmt: skip


def test_a_wrong_decision_is_said_and_does_not_hinder_registration(near: TestClient) -> None:
    with answering(lambda _: {"actions": [[1.0, 2.0]]}) as url:
        found = tried(near, url, observation=STATE, action=JOINTS)

    assert found["fits"] and found["about"]["dialect"] == "openpi"
    assert found["steps"][-1]["name"] == "decision"
    assert found["steps"][-1]["outcome"] == "failed" and found["steps"][-1]["detail"]


def failed(found: dict[str, Any]) -> tuple[str, str]:
    assert not found["fits"] and found["about"] is None
    last = found["steps"][-1]
    assert last["outcome"] == "failed" and last["hint"]
    return last["name"], last["detail"]


def test_what_hinders_a_connection_is_told_apart(near: TestClient, here: TestClient) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    refused = failed(tried(near, f"ws://127.0.0.1:{port}"))
    with raw(lambda there: there.sendall(b"HTTP/1.1 200 OK\r\n\r\nhello")) as url:
        wrong = failed(tried(near, url))
    with answering(lambda _: {}) as url:
        unsaid = failed(tried(near, url))
    forbidden = failed(tried(here, "wss://127.0.0.1:1"))
    plain = failed(tried(here, "ws://127.0.0.1:1"))
    scheme = failed(tried(near, "http://127.0.0.1:1"))

    assert refused[0] == "connection" and "Connection refused" in refused[1]
    assert wrong[0] == "connection" and "is no such server" in wrong[1]
    assert "does not say what it wants to see" in unsaid[1]
    assert forbidden[0] == "address" and "not a public address" in forbidden[1]
    assert plain[0] == "address" and "not encrypted" in plain[1]
    assert scheme[0] == "address" and "is no URL such as ws://host" in scheme[1]


def test_what_is_no_remote_policy_is_refused(near: TestClient) -> None:
    for spec, field in (({}, "spec.url"), ({"url": "ws://x", "wire": "telnet"}, "spec.wire")):
        answer = near.post(f"{API}/policies/connection", json={"spec": spec})

        assert answer.status_code == 422
        assert [one["field"] for one in problem_of(answer)["errors"]] == [field]


def test_servers_that_keep_silent_stop_no_page(
    near: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    over = threading.Event()

    def silent(*_: object) -> trial.Trial:
        over.wait(60)
        return trial.Trial(about=None, steps=[])

    def unreachable(*_: object) -> None:
        over.wait(60)
        raise BadPolicy("It keeps silent.")

    monkeypatch.setattr(trial, "tried", silent)
    monkeypatch.setattr(Remote, "found", unreachable)
    silence = {"kind": "remote", "url": "ws://127.0.0.1:9"}
    wanted = {"name": "mine", "spec": silence}
    with ThreadPoolExecutor(2 * THREADS + 1) as people:
        trials: list[Future[Any]] = [
            people.submit(tried, near, silence["url"]) for _ in range(THREADS)
        ]
        trials += [people.submit(near.post, f"{API}/policies", json=wanted) for _ in range(THREADS)]
        page = people.submit(near.get, f"{API}/policies")
        try:
            assert page.result(20).status_code == 200
            assert not any(one.done() for one in trials)
        finally:
            over.set()
