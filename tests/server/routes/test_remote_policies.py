"""Policies on other machines, registered over HTTP and held to what their servers take."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from server import lifecycle, policies
from server.db import Database
from server.jobs import draft
from server.lifecycle import end_attempt
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, hub_of, problem_of
from tests.workers.remote.peers import JOINTS, STATE, answering, declared, websocket
from tests.workers.remote.test_vla_eval import ModelServer
from tests.workers.remote.test_vla_eval import maps as vla_eval_maps
from workers.remote.maps import Declaration, everything

PLAIN = {"kind": "remote", "observation": STATE, "action": JOINTS}
OURS = Declaration(model="mine", observation=everything(), max_sessions=3).message()


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


def register(here: TestClient, url: str, **changes: object) -> object:
    return here.post(
        f"{API}/policies", json={"name": "far", "spec": PLAIN | {"url": url} | changes}
    )


def test_a_server_is_asked_what_it_is(tmp_path: Path) -> None:
    with client(tmp_path, allow_remote=["127.0.0.1"]) as here:
        with answering(lambda _: {}) as url:
            plain = register(here, url, concurrency=8).json()
        with answering(lambda _: {}, OURS) as url:
            ours = register(here, url, observation=None, action=None, model="best").json()

        found = here.get(f"{API}/policies/far@1").json()

    assert (plain["spec"]["dialect"], plain["spec"]["concurrency"]) == ("openpi", 1)
    assert plain["spec"]["observation"]["prompt"]["from"] == ["instruction"]
    assert found == plain
    assert (ours["spec"]["dialect"], ours["spec"]["concurrency"]) == ("hide", 3)
    assert (ours["version"], ours["spec"]["model"]) == (2, "mine")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("ws://127.0.0.1:1", "not encrypted"),
        ("wss://127.0.0.1:1", "not a public address"),
        ("wss://[::ffff:169.254.169.254]", "not a public address"),
        ("http://127.0.0.1", "is no URL such as ws://host"),
        ("wss://me:secret@example.org", "neither user, password nor fragment"),
    ],
)
def test_an_address_that_a_stranger_may_not_name(here: TestClient, url: str, message: str) -> None:
    refused = register(here, url)

    assert refused.status_code == 422
    assert message in problem_of(refused)["detail"]
    assert here.get(f"{API}/policies/far").status_code == 404


def test_a_server_of_another_wire_is_asked_what_it_is(tmp_path: Path) -> None:
    with client(tmp_path, allow_remote=["127.0.0.1"]) as here, websocket(ModelServer()) as url:
        found = register(here, url, **vla_eval_maps(concurrency=3)).json()["spec"]

    assert (found["wire"], found["dialect"], found["model"]) == ("vla_eval", "vla_eval", "Small")
    assert found["concurrency"] == 3
    assert found["observation"]["images"]["agentview"]["from"] == ["front.rgb"]


@pytest.mark.parametrize(
    ("wire", "url", "changes", "message"),
    [
        ("act", "http://1.1.1.1/act", {}, "not encrypted; use https://"),
        ("act", "https://169.254.169.254/act", {}, "not a public address"),
        ("act", "ws://1.1.1.1", {}, "is no URL such as http://host"),
        ("gr00t", "tcp://1.1.1.1", {}, "not encrypted; have the operator allow 1.1.1.1:5555"),
        ("vla_eval", "https://1.1.1.1", {}, "is no URL such as ws://host"),
        ("act", "https://1.1.1.1", {"observation": None, "action": None}, "does not say"),
        ("act", "https://1.1.1.1", {"dialect": "hide"}, "hide is a dialect of openpi, not of act"),
        ("telnet", "ws://1.1.1.1", {}, "'openpi', 'vla_eval', 'act' or 'gr00t'"),
    ],
)
def test_what_does_not_fit_its_wire_is_refused(
    here: TestClient, wire: str, url: str, changes: dict[str, object], message: str
) -> None:
    refused = register(here, url, wire=wire, **changes)

    assert refused.status_code == 422
    assert message in problem_of(refused)["detail"]


def test_a_server_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    with client(tmp_path, allow_remote=["127.0.0.0/8"]) as here, answering(lambda _: {}) as url:
        refused = register(here, url, observation=None, action=None)
        unknown = register(here, url, observation={"x": {"from": "hidden"}})
        half = register(here, url, action=None)

    assert "does not say what it wants to see" in problem_of(refused)["detail"]
    assert "no source 'hidden'" in problem_of(unknown)["detail"]
    assert "declared together" in problem_of(half)["detail"]


def registered(database: Database, name: str, url: str, concurrency: int) -> str:
    spec = declared(url, concurrency=concurrency, dialect="openpi")
    with database.writing() as session:
        return policies.register(session, name, spec).id


def test_a_server_plays_no_more_at_a_time_than_it_takes(database: Database) -> None:
    registered(database, "far", "ws://far:1", 2)
    registered(database, "far again", "ws://far:1", 2)
    registered(database, "other", "ws://other:1", 1)
    with database.writing() as session:
        for name in ("far", "far again", "other"):
            ledgers.created(session, name, tasks=["search_drawer"])
        leased = [ledgers.leased(session) for _ in range(3)]
        assert None not in leased
        assert lifecycle.next_shard(session) is None

        attempt, shard = leased[0]
        end_attempt(session, attempt, "it crashed")
        waiting = lifecycle.next_shard(session)

    assert waiting is not None
    urls = [one.evaluation.policy_version.spec["url"] for _, one in leased]
    assert sorted(urls) == ["ws://far:1", "ws://far:1", "ws://other:1"]
    assert (
        waiting.evaluation.policy_version.spec["url"] == shard.evaluation.policy_version.spec["url"]
    )


def test_a_worker_is_told_where_it_may_connect(tmp_path: Path) -> None:
    with client(tmp_path, allow_remote=["lab.example:8000"]) as here:
        hub = hub_of(here)
        registered(hub.database, "far", "ws://lab.example:8000", 1)
        with hub.database.writing() as session:
            ledgers.created(session, "far", tasks=["search_drawer"], episodes=1)
            shard = lifecycle.next_shard(session)
            assert shard is not None
            job = draft(
                session,
                shard,
                store=hub.blobs,
                server="http://127.0.0.1:9",
                episode_limit=60.0,
                allow_python=False,
                allow_remote=hub.settings.allow_remote,
            )

    assert (job.policy.kind, job.allowed) == ("remote", ("lab.example:8000",))
    assert job.episode_limit > 60 + job.policy.first_timeout
