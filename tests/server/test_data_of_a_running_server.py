"""A server with real workers is copied, verified and put back while it plays."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.server import tampering
from tests.server.running import ROOT, RunningServer, until

pytestmark = [pytest.mark.slow, pytest.mark.long]
MEASURED = ("success", "exact", "failure", "decisions", "scene_hash", "final_state_hash")


def hide(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "server.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def measured(server: RunningServer, evaluation: str) -> dict[str, list[Any]]:
    return {one["id"]: [one[field] for field in MEASURED] for one in server.episodes(evaluation)}


def test_what_is_copied_while_workers_play_ends_in_the_same_scores(tmp_path: Path) -> None:
    data, backup, restored = tmp_path / "data", tmp_path / "backup", tmp_path / "restored"
    with RunningServer(data, "--no-references", workers=1) as server:
        wanted = {"policy": "expert", "tasks": ["push_button_times"], "episodes": 6}
        id = server.post("/evaluations", wanted)["id"]
        until(lambda: server.final(id) >= 2, "two episodes")

        made = hide("backup", backup, "--data", data)
        server.finished(id)
        whole = measured(server, id)
        verified = hide("verify", id, "--data", data, "--sample", 1, "--workers", 1)
    back = hide("restore", backup, "--data", restored)
    with RunningServer(restored, "--no-references", workers=1) as other:
        final = other.final(id)
        other.finished(id)
        again = measured(other, id)

    assert (made.returncode, back.returncode) == (0, 0), made.stderr + back.stderr
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "1 episodes played again, 1 of them to the last bit" in verified.stdout
    assert 2 <= final <= 6
    assert again == whole
    tampering.alter(restored, "UPDATE episodes SET success = 0, exact = 0, failure = 'unfinished'")
    forged = hide("verify", "--data", restored, "--sample", 0)
    assert forged.returncode == 1
    assert "score): success: stored 0 of 6, found 6 of 6" in forged.stdout
