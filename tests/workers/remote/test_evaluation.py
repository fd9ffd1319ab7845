"""Whole episodes with policies that are served."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.server import ServerConnection

from hide_tasks.contract import CAMERAS
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.server.running import until
from tests.workers.remote import test_act, test_gr00t
from tests.workers.remote.peers import answering, websocket
from tests.workers.remote.test_serving import served
from tests.workers.remote.test_vla_eval import ModelServer
from tests.workers.test_policy_process import POLICIES
from workers.evaluation import Evaluation, Watcher, evaluate
from workers.remote import arrays
from workers.remote.maps import Declaration, everything
from workers.results import Results

TASK = "push_button_times"


class Notes(Watcher):
    """Keeps why attempts came to nothing."""

    def __init__(self) -> None:
        self.reasons: list[str] = []

    def lost(self, episode, reason: str, final: bool) -> None:
        self.reasons.append(reason)


def played(policy: str, folder: Path, notes: Watcher | None = None, **settings: object) -> Results:
    wanted = Evaluation(policy, (TASK,), episodes=1, recordings=False, **settings)
    return evaluate(wanted, folder, workers=1, watcher=notes)


def test_a_served_policy_plays_the_very_episode_that_it_plays_here(tmp_path: Path) -> None:
    here = played(f"python:{POLICIES}:Stays", tmp_path / "here")
    with served() as url:
        there = played(url, tmp_path / "there")

    assert there.episodes[0].model_dump(exclude={"timing"}) == here.episodes[0].model_dump(
        exclude={"timing"}
    )
    assert there.remote is not None
    assert "front/rgb" in there.remote.pop("sees")
    assert there.remote == {
        "dialect": "hide",
        "model": "Stays",
        "sessions": 1,
        "cameras": list(CAMERAS),
        "acts": "action",
        "stateless_transport": False,
    }


def test_a_stock_server_plays_with_declared_maps(tmp_path: Path) -> None:
    (tmp_path / "maps.toml").write_text(
        'timeout = 20.0\n[observation]\nprompt = {from = "instruction"}\n'
        'state = {from = ["joint_positions", "gripper_opening"]}\n'
        '[action]\nkind = "joint_position"\nexecute = 20\n'
    )

    def stays(message: dict[str, object]) -> dict[str, object]:
        return {"actions": np.tile(message["state"], (50, 1))}

    with answering(stays) as url:
        results = played(url, tmp_path / "run", maps=tmp_path / "maps.toml")

    [episode] = results.episodes
    assert episode.failure is not None
    assert not episode.failure.startswith("policy_"), episode.detail
    assert "rows of dense actions is spent" in episode.detail
    assert results.remote is not None and results.remote["stateless_transport"]


STILL = np.tile([0.0] * 6 + [1.0], (100, 1))  # displacements of nothing, the fingers open


@contextmanager
def standing_still(wire: str) -> Iterator[str]:
    """The address of a server of that wire whose policy never moves."""
    if wire == "act":
        with test_act.answering(STILL) as url:
            yield url
    elif wire == "gr00t":
        with test_gr00t.serving(test_gr00t.Server([{"actions": STILL}, {}])) as url:
            yield url
    else:
        with websocket(ModelServer({"actions": STILL})) as url:
            yield url


@pytest.mark.parametrize("wire", ["vla_eval", "act", "gr00t"])
def test_a_server_of_another_wire_plays(wire: str, tmp_path: Path) -> None:
    (tmp_path / "maps.toml").write_text(
        f'wire = "{wire}"\ntimeout = 20.0\n[observation]\nprompt = {{from = "instruction"}}\n'
        '[action]\nkind = "ee_delta"\n'
    )

    with standing_still(wire) as url:
        results = played(url, tmp_path / "run", maps=tmp_path / "maps.toml")

    [episode] = results.episodes
    assert episode.failure is not None
    assert not episode.failure.startswith("policy_"), episode.detail
    assert results.remote is not None
    assert results.remote["dialect"] == wire
    assert results.remote["stateless_transport"] is (wire == "act")


def test_a_server_that_is_gone_costs_no_episode(tmp_path: Path) -> None:
    notes = Notes()
    looks = iter([arrays.pack(Declaration(observation=everything()).message())])

    def handler(connection: ServerConnection) -> None:
        if greeting := next(looks, None):
            connection.send(greeting)
            connection.recv()
        else:
            connection.close(1013, "try again later")

    with websocket(handler) as url:
        results = played(url, tmp_path / "run", notes)

    assert results.episodes == []
    assert len(notes.reasons) == 3
    assert all("Unreachable" in reason and "1013" in reason for reason in notes.reasons)


@pytest.mark.long
def test_a_served_checkpoint_plays_the_very_episode_that_it_plays_here(tmp_path: Path) -> None:
    checkpoint = tiny_checkpoint(tmp_path / "tiny.safetensors")
    here = played(str(checkpoint), tmp_path / "here")
    command = [sys.executable, "-m", "server.cli", "serve-policy", str(checkpoint), "--port", "0"]
    log = tmp_path / "log"
    with log.open("wb") as output, subprocess.Popen(command, stderr=output) as server:
        try:
            until(lambda: "Ctrl-C stops" in log.read_text(), "the server", 120.0)
            url = log.read_text().split()[1]
            there = played(url, tmp_path / "there")
        finally:
            server.terminate()
            assert server.wait(30) == 0

    assert there.episodes[0].final_state_hash == here.episodes[0].final_state_hash
    assert there.episodes[0].decisions == here.episodes[0].decisions
