"""Running episodes, watched: the worker's growing recording reaches whoever asks, also late."""

import hashlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.processes import gone
from tests.server.running import RunningServer, until
from workers.recording import properties_of
from workers.simulator_process import descendants

SLOW = {"kind": "python", "target": "tests.server.slow_policy:Slow"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    data = tmp_path_factory.mktemp("live") / "data"
    with RunningServer(data, "--allow-python", "--no-references", workers=1) as running:
        running.post("/policies", {"name": "slow", "spec": SLOW})
        yield running


class Viewer(threading.Thread):
    """Gets a recording as a browser does, and notes when its pieces came."""

    def __init__(self, url: str):
        super().__init__(daemon=True)
        self.url = url
        self.content, self.times = b"", []
        self.cut = False  # the connection broke before the end
        self.start()

    def run(self) -> None:
        try:
            with httpx.stream("GET", self.url, trust_env=False, timeout=60) as response:
                for piece in response.iter_raw():
                    self.content += piece
                    self.times.append(time.monotonic())
        except httpx.RemoteProtocolError:
            self.cut = True


def running_episode(server: RunningServer, evaluation: str) -> dict:
    def find() -> dict | None:
        running = server.get(f"/evaluations/{evaluation}/episodes", state="running")["items"]
        return running[0] if running else None

    return until(find, "a running episode")


@pytest.mark.slow
def test_a_running_episode_is_watched_from_its_first_byte_by_everyone(
    server: RunningServer, tmp_path: Path
) -> None:
    wanted = {"policy": "slow", "tasks": ["push_button_times"], "episodes": 1}
    evaluation = server.post("/evaluations", wanted)["id"]
    episode = running_episode(server, evaluation)
    assert episode["live"] and episode["recording"].endswith(".rrd")

    early = Viewer(server.url + episode["recording"])
    until(lambda: early.content, "the first piece")
    begun = time.monotonic()
    time.sleep(2.0)
    late = Viewer(server.url + episode["recording"])
    done = server.finished(evaluation)
    early.join(20)
    late.join(20)

    kept = server.client.get(episode["recording"]).content
    assert done["state"] == "completed"
    assert early.content == late.content == kept
    assert early.times[-1] - begun > 1.5 and len(early.times) >= 3  # it came while it was played
    assert late.times[0] < early.times[-1]
    file = tmp_path / "kept.rrd"
    file.write_bytes(kept)
    assert properties_of(file)["decisions"] == 8
    blob = hashlib.sha256(kept).hexdigest()
    assert (server.data / "blobs" / blob[:2] / blob[2:]).read_bytes() == kept


@pytest.mark.slow
def test_a_cancelled_evaluation_stops_at_once_and_keeps_what_is_final(
    server: RunningServer,
) -> None:
    wanted = {"policy": "slow", "tasks": ["reopen_drawer"], "episodes": 10}
    evaluation = server.post("/evaluations", wanted)["id"]
    until(lambda: server.final(evaluation) >= 1, "an episode")
    episode = running_episode(server, evaluation)
    watching = Viewer(server.url + episode["recording"])
    until(lambda: watching.content, "the first piece")
    below = [pid for worker in server.workers for pid in descendants(worker)]
    kept = [one for one in server.episodes(evaluation) if one["state"] == "final"]

    server.post(f"/evaluations/{evaluation}/cancellation")
    asked = time.monotonic()
    done = server.finished(evaluation, 15)
    took = time.monotonic() - asked
    watching.join(10)

    assert done["state"] == "cancelled" and took < 10
    assert below and until(lambda: gone(below), "the end of the processes", 5)
    assert not watching.is_alive() and watching.cut
    after = {one["id"]: one for one in server.episodes(evaluation)}
    assert all(after[one["id"]] == one for one in kept)
    assert {one["state"] for one in after.values()} == {"final", "pending"}
