"""The tour: an evaluation from its submission to the leaderboard, through two deaths.

Everything is real: the server is `hide serve`, its workers play in PyBullet, the policy lives in
a process of its own, and what dies is killed.
"""

import sys
from pathlib import Path
from typing import Any

import pytest

from tests.processes import gone
from tests.server.running import RunningServer, kill, until
from workers.recording import properties_of
from workers.simulator_process import descendants

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc"),
]
TASKS = ["push_button_times", "reopen_drawer", "search_drawer"]  # one per category
EPISODES = 12 * len(TASKS)

MEASURED = ("success", "exact", "failure", "decisions", "scene_hash", "final_state_hash", "fence")


def measured(episodes: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """What was measured of the final episodes, by id."""
    return {
        one["id"]: [one[field] for field in MEASURED] for one in episodes if one["state"] == "final"
    }


def test_the_life_of_an_evaluation(tmp_path: Path) -> None:
    with RunningServer(tmp_path / "data", "--allow-python", "--no-references") as server:
        # A researcher registers a policy and asks for some of the benchmark.
        spec = {"kind": "python", "target": "tests.workers.some_policies:Stops"}
        version = server.post("/policies", {"name": "stops", "spec": spec})
        wanted = {"policy": "stops@1", "tasks": TASKS, "episodes": EPISODES // len(TASKS)}
        evaluation = server.post("/evaluations", wanted)
        id = evaluation["id"]

        assert version["version"] == 1
        assert evaluation["state"] == "queued"
        assert evaluation["progress"]["expected"] == EPISODES

        # Shards are handed out, and each finished episode is in the ledger at once.
        until(lambda: server.final(id) >= 5, "five episodes")
        assert server.get(f"/evaluations/{id}")["state"] == "running"

        # A worker is killed: its attempt is lost, its shard goes to another one.
        below = descendants(server.workers[0])
        kill(server.workers[0])

        def lost() -> list[dict[str, Any]]:
            attempts = server.get(f"/evaluations/{id}/attempts")["items"]
            return [one for one in attempts if one["state"] == "lost"]

        [attempt] = until(lost, "a lost attempt")
        assert "signal 9" in attempt["reason"]
        until(lambda: gone(below), "the end of its simulator and policy", 10)

        # The server is killed: with it everything below, and nothing that was final is lost.
        until(lambda: server.final(id) >= 15, "fifteen episodes")
        below = descendants(server.process.pid)
        before = measured(server.episodes(id))
        server.kill()
        until(lambda: gone(below), "the end of its workers", 10)

        # It is started again, and goes on by itself.
        server.start()
        done = server.finished(id)

        after = measured(server.episodes(id))
        assert done["state"] == "completed"
        assert done["progress"]["final"] == len(after) == EPISODES
        assert before.items() <= after.items()
        stopped = [
            one for one in server.get(f"/evaluations/{id}/attempts")["items"] if one["reason"]
        ]
        assert {one["reason"] for one in stopped} >= {"the server stopped"}

        # Its score has intervals; the leaderboard shows nothing that covers only a part.
        board = server.get("/leaderboard", verdict="exact")
        overall = done["verdicts"]["exact"]
        assert (overall["episodes"], overall["value"]) == (EPISODES, 0.0)
        assert 0.0 < overall["high"] < 0.2
        assert (board["rows"], board["unlisted"]) == ([], 1)

        # A reviewer asks why an episode failed: every decision, its hidden state, its recording.
        [first, *_] = server.episodes(id)
        decisions = server.get(f"/episodes/{first['id']}/decisions")
        spans = server.get(f"/episodes/{first['id']}/spans")
        recording = tmp_path / "episode.rrd"
        recording.write_bytes(server.client.get(first["recording"]).raise_for_status().content)
        assert first["failure"] == "undercount"
        assert [one["action"]["kind"] for one in decisions] == ["stop"]
        assert {"hidden", "stage"} <= {span["kind"] for span in spans}
        assert properties_of(recording)["failure"] == "undercount"

        below = descendants(server.process.pid)
        server.stop()
        until(lambda: gone(below), "the end of its workers", 10)
