"""Policies that break what plays them cost themselves, and leave every worker as it was."""

from contextlib import closing
from typing import Any

import pytest

from server.blobs import Blobs
from server.db import Database
from server.settings import LEDGER
from tests.chaos.systems import System, marks_of
from tests.server import ledgers
from workers.policies import NO_TORCH, has_torch

needs_torch = pytest.mark.skipif(not has_torch(), reason=NO_TORCH)


def upload(system: System, name: str, content: bytes) -> str:
    """A policy that is a checkpoint, as if nothing had been looked at; its blob's SHA-256."""
    store = Blobs(system.server.data / "blobs")
    with closing(Database(system.server.data / LEDGER)) as database:
        ledgers.uploaded(database, store, name, content)
    return store.put(content)


@pytest.fixture
def others(disturbed: System, undisturbed: dict[int, tuple[Any, ...]]) -> Any:
    """Afterwards the same worker plays other policies as it did before."""
    supervisor = disturbed.pid("supervisor")
    assert supervisor
    yield
    assert disturbed.pid("supervisor") == supervisor
    evaluation = disturbed.ask()
    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.scores(evaluation) == undisturbed


@pytest.mark.usefixtures("others")
def test_a_policy_that_crashes_in_every_episode_is_scored(disturbed: System) -> None:
    evaluation = disturbed.ask("poison")

    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.lost(evaluation) == []
    for episode in disturbed.server.episodes(evaluation):
        assert episode["failure"] == "policy_error"
        assert "had died 2 times before: signal 11, SIGSEGV" in episode["detail"]


@needs_torch
@pytest.mark.usefixtures("others")
def test_a_checkpoint_that_is_damaged_on_the_disk_is_no_policys_failure(disturbed: System) -> None:
    sha256 = upload(disturbed, "rotten", b"weights, as they came")
    Blobs(disturbed.server.data / "blobs").path(sha256).write_bytes(b"weights, as they are")

    evaluation = disturbed.ask("rotten")

    done = disturbed.finished(evaluation)
    assert (done["state"], done["progress"]["final"]) == ("incomplete", 0)
    assert len(disturbed.lost(evaluation)) == 3
    assert "SHA-256" in done["reason"]


@needs_torch
@pytest.mark.parametrize(
    "system", [pytest.param("pebble", marks=marks_of("pebble"))], indirect=True, scope="session"
)
@pytest.mark.usefixtures("others")
def test_a_checkpoint_that_cannot_be_loaded_is_scored(disturbed: System) -> None:
    upload(disturbed, "nonsense", b"\xff" * 1000)

    evaluation = disturbed.ask("nonsense", episodes=1)

    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.lost(evaluation) == []
    [episode] = disturbed.server.episodes(evaluation)
    assert episode["failure"] == "policy_error" and episode["detail"]
