"""Every example, run as its reader runs it: against a server with a worker, in a process apart."""

import csv
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.seek_model.checkpoints import tiny_checkpoint
from tests.server.running import ROOT, RunningServer
from tests.workers.remote.test_serving import served
from workers.checkpoint_cache import FOLDER

pytestmark = pytest.mark.slow
EXAMPLES = ROOT / "examples"
TASK = "push_button_times"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(folder / "cache"))
        options = ("--no-references", "--allow-remote", "127.0.0.1")
        with RunningServer(folder / "data", *options, workers=1) as running:
            yield running


def run(server: RunningServer, name: str, *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of an example."""
    finished = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *map(str, arguments)],
        env=os.environ | {"HIDE_URL": server.url, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=280,
    )
    return finished.returncode, finished.stdout, finished.stderr


def test_there_are_three_short_ones() -> None:
    found = {file.name: len(file.read_text().splitlines()) for file in EXAMPLES.glob("*.py")}

    assert set(found) == {"submit_and_wait.py", "evaluate_a_list.py", "watch_a_remote_policy.py"}
    assert max(found.values()) <= 60


@pytest.mark.long
def test_a_checkpoint_is_submitted_and_waited_for(server: RunningServer, tmp_path: Path) -> None:
    file = tiny_checkpoint(tmp_path / "tiny.safetensors")

    status, output, errors = run(server, "submit_and_wait.py", file, TASK)

    assert status == 0, errors
    lines = output.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["success", "exact"]
    assert all(" of 1 [" in line for line in lines)
    assert f"{TASK} 0: " in errors and f"{server.url}/evaluations/ev_" in errors
    assert server.get("/policies/tiny")["spec"]["kind"] == "checkpoint"


def test_many_are_evaluated_from_a_list(server: RunningServer, tmp_path: Path) -> None:
    file = tmp_path / "policies.csv"
    rows = [f"expert,{TASK},1", f"noop,{TASK} search_drawer,1", f"nobody,{TASK},1"]
    file.write_text("\n".join(["policy,tasks,episodes", *rows]))

    status, output, errors = run(server, "evaluate_a_list.py", file)

    assert status == 1 and errors.startswith("nobody: ")
    found = list(csv.DictReader(output.splitlines()))
    told = [(one["policy"], one["state"], one["episodes"], one["success"]) for one in found]
    assert told == [("expert", "completed", "1", "1.0000"), ("noop", "completed", "2", "0.0000")]


def test_a_remote_policy_is_watched(server: RunningServer) -> None:
    with served("Stays") as url:
        status, output, errors = run(server, "watch_a_remote_policy.py", url, "far", TASK)

    assert status == 0, errors
    [failed] = output.splitlines()
    assert failed.startswith(f"{TASK} 0 (") and "presses_done" in failed
    assert "0 of 1 exact" in errors
