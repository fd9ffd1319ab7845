"""The commands that play an episode again, and its actions as a file that they read."""

import json
from pathlib import Path
from typing import Any

import pytest
from httpx import Response

from hide_tasks.suite import episode as spec_of
from server import reruns
from server.schemas.policies import PolicyVersionPublic
from tests.server import ledgers
from tests.server.clients import API, TestClient, hub_of
from workers.policies import Actions, parse
from workers.protocol import CheckpointPolicy, PolicySpec, PythonPolicy, RemotePolicy, ReplayPolicy

SHA256 = "a" * 64


def ask(here: TestClient, path: str, **wanted: Any) -> Any:
    """Of the only final episode, whose index is 0."""
    return asked(here, path, **wanted).json()


def asked(here: TestClient, path: str, **wanted: Any) -> Response:
    """The same as it is answered."""
    hub = hub_of(here)
    done = ledgers.evaluated(
        hub.database, hub.blobs, tasks=["search_drawer"], episodes=1, split="val", **wanted
    )
    with hub.database.reading() as session:
        [episode] = ledgers.episodes_of(session, done)
        id = episode.id
    answer = here.get(f"{API}/episodes/{id}/{path}")
    assert answer.status_code == 200, answer.text
    return answer


def test_the_command_names_the_policy_and_the_episode(here: TestClient) -> None:
    found = ask(here, "rerun")

    where = "--tasks search_drawer --split val --index 0"
    assert found["command"] == f"hide eval expert {where}"
    assert found["replay"] == f"hide eval replay:search_drawer-val-000.json {where}"
    assert (found["notes"], found["final_state_hash"]) == ([], "f" * 64)


def test_other_rules_are_said(here: TestClient) -> None:
    assert ask(here, "rerun", rules="parity")["command"].endswith("--index 0 --rules parity")


def test_the_actions_have_the_name_that_the_command_reads(here: TestClient) -> None:
    headers = asked(here, "actions.json").headers

    assert headers["Content-Disposition"] == 'attachment; filename="search_drawer-val-000.json"'


def test_the_actions_are_a_file_that_can_be_replayed(here: TestClient, tmp_path: Path) -> None:
    file = tmp_path / "actions.json"
    found = ask(here, "actions.json")

    file.write_text(json.dumps(found))

    chosen = parse(f"replay:{file}").for_episode(spec_of("search_drawer", "val", 0))
    assert isinstance(chosen, Actions)
    assert len(chosen.actions) == len(found["actions"]) == 3


@pytest.mark.parametrize(
    ("spec", "words", "note"),
    [
        (PythonPolicy(target="my.py:Mine"), ["python:my.py:Mine"], "importable"),
        (
            CheckpointPolicy(sha256=SHA256, size=3, timeout=5.0),
            ["mine.safetensors", "--policy-timeout", "5"],
            SHA256,
        ),
        (RemotePolicy(url="wss://a.example"), ["wss://a.example"], "still be served"),
        (ReplayPolicy(evaluation="ev_1"), ["replay:search_drawer-val-000.json"], "downloaded"),
    ],
)
def test_every_kind_of_policy_has_its_command(
    here: TestClient, spec: PolicySpec, words: list[str], note: str
) -> None:
    version = here.get(f"{API}/policies/expert").json()
    mine = PolicyVersionPublic.model_validate({**version, "policy": "mine", "spec": spec})

    assert list(reruns.policy_of(mine, "search_drawer-val-000.json")) == words
    assert note in " ".join(reruns.needs_of(mine))
