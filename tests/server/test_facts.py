"""What is known of a policy's memory."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from seek_model.presets import CLOCK, NAMES, preset
from server import facts
from server.models import PolicyVersion
from server.schemas.policies import PolicyFacts
from tests.server import ledgers
from tests.server.clients import hub_of
from workers.policies import BUILTIN


@pytest.mark.parametrize(
    ("name", "memory", "window"),
    [
        ("seek-small", "SCM+WCM+PAM", 6),
        ("seek-small/length_2", "SCM+WCM+PAM", 2),
        ("seek-small/length_0", "SCM+PAM", 0),
        ("seek-small/pam", "PAM", 0),
        ("seek-small/scm_wcm", "SCM+WCM", 6),
        ("sam2act-small", "none", 0),
        ("sam2act_plus-small", "WCM", 9),
    ],
)
def test_a_configuration_names_its_components(name: str, memory: str, window: int) -> None:
    found = facts.of_config(preset(name))

    assert (found.memory, found.window, found.preset) == (memory, window, name)


def test_a_clock_and_an_oracle_are_told() -> None:
    assert facts.of_config(preset(f"seek-small{CLOCK}")).clock
    assert not facts.of_config(preset("seek-small")).clock
    assert facts.of_config(preset("seek-small/anchor_oracle")).privileged
    assert not facts.of_config(preset("seek-small")).privileged


@pytest.mark.parametrize("name", BUILTIN)
def test_every_built_in_policy_is_known(name: str) -> None:
    known = facts.of_version(PolicyVersion(spec={"kind": "builtin", "name": name}))

    assert known.source == "built-in"
    assert known.privileged is not None


@pytest.mark.parametrize("name", [*NAMES, "seek-small+clock"])
def test_a_checkpoint_from_before_is_known_by_its_preset(name: str) -> None:
    old = PolicyVersion(spec={"kind": "checkpoint", "model": name}, facts=None)

    assert facts.of_version(old) == facts.of_config(preset(name))


@pytest.mark.parametrize(
    "spec",
    [
        {"kind": "checkpoint", "model": "somebody's own"},
        {"kind": "remote", "url": "ws://127.0.0.1:1"},
        {"kind": "python", "target": "a:B"},
    ],
)
def test_what_says_nothing_is_undeclared(spec: dict[str, Any]) -> None:
    found = facts.of_version(PolicyVersion(spec=spec))

    assert (found.source, found.memory, found.clock) == ("unknown", "undeclared", None)


def test_an_uploads_facts_are_kept(here: TestClient) -> None:
    hub = hub_of(here)
    ledgers.uploaded(hub.database, hub.blobs, "two", b"2", model="seek-small/length_2")

    shown = PolicyFacts.model_validate(here.get("/api/v1/policies/two").json()["facts"])

    assert shown == facts.of_config(preset("seek-small/length_2"))


def test_who_registers_a_policy_declares_its_memory(here: TestClient) -> None:
    spec = {"kind": "builtin", "name": "noop"}
    said = {"memory": "LSTM", "clock": True, "privileged": False}

    sent = here.post("/api/v1/policies", json={"name": "ours", "spec": spec, "declared": said})

    assert sent.status_code == 201, sent.text
    found = sent.json()["facts"]
    assert found["source"] == "declared"
    assert {name: found[name] for name in said} == said


def test_a_declared_memory_is_a_name(here: TestClient) -> None:
    spec, said = {"kind": "builtin", "name": "noop"}, {"memory": "<b>"}

    sent = here.post("/api/v1/policies", json={"name": "ours", "spec": spec, "declared": said})

    assert sent.status_code == 422
    assert sent.json()["errors"][0]["field"] == "declared.memory"
