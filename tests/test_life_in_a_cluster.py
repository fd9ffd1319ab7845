"""An evaluation that machines elsewhere play: server, scheduler and workers are processes of their
own, which know each other by the server's address and a token; the ledger is in PostgreSQL where it
is installed.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.processes import gone
from tests.server import ledgers, postgres
from tests.server.running import ROOT, RunningServer, until
from workers.simulator_process import descendants

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'hide-seek[dask]'")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc"),
]
HIDE = [sys.executable, "-m", "server.cli"]
TASKS = ["reopen_drawer", "search_drawer"]
EPISODES = 10 * len(TASKS)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def running(folder: Path, name: str, *arguments: str, token: str) -> Iterator[subprocess.Popen]:
    """A hide command, killed at the end."""
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            [*HIDE, *arguments],
            cwd=ROOT,
            env=os.environ | {"HIDE_TOKEN": token},
            stdout=log,
            stderr=log,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("sqlite", marks=pytest.mark.long),
        pytest.param("postgresql", marks=postgres.needs_postgres),
    ],
)
def test_machines_elsewhere_play_and_one_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    if kind == "postgresql":
        monkeypatch.setenv("HIDE_SERVER_DATABASE", ledgers.laid_in_postgres(tmp_path / "data"))
    data, port = tmp_path / "data", free_port()
    making = [*HIDE, "token", "create", "owner", "--scope", "worker", "--data", str(data)]
    made = subprocess.run(making, cwd=ROOT, check=True, capture_output=True, text=True)
    token = made.stdout.strip()
    options = ["--no-references", "--token", "--scheduler", f"tls://127.0.0.1:{port}"]
    with RunningServer(data, *options, workers=0) as server, ExitStack() as stack:
        printed = (tmp_path / "data.log").read_text().split("token=")[1].split()[0]
        server.client.headers["Authorization"] = f"Bearer {printed}"

        # A token that is for something else lets no machine in.
        refused = subprocess.run(
            [*HIDE, "worker", server.url], cwd=ROOT, capture_output=True, text=True, timeout=60
        )
        assert refused.returncode == 2 and "401" in refused.stderr

        # Nobody is there yet: what is asked for waits.
        wanted = {"policy": "noop", "tasks": TASKS, "episodes": EPISODES // len(TASKS)}
        id = server.post("/evaluations", wanted)["id"]
        assert server.client.get("/api/v1/health/ready").json()["checks"]["cluster"] != "ok"

        at = ["--host", "127.0.0.1", "--port", str(port)]
        stack.enter_context(
            running(tmp_path, "scheduler", "scheduler", server.url, *at, token=token)
        )
        machines = [
            stack.enter_context(
                running(tmp_path, f"w{n}", "worker", server.url, "--slots", "1", token=token)
            )
            for n in range(2)
        ]
        until(lambda: server.final(id) >= 1, "an episode", 180)

        # A machine is lost in mid-run: what it played goes on elsewhere, under another fence.
        below = descendants(machines[0].pid)
        machines[0].kill()
        until(lambda: gone(below), "the end of what it ran", 10)

        done = server.finished(id, 240)
        attempts = server.get(f"/evaluations/{id}/attempts", limit=200)["items"]
        assert (done["state"], done["progress"]["final"]) == ("completed", EPISODES)
        assert {one["reason"] for one in attempts if one["state"] == "lost"} <= {
            "its worker disappeared"
        }
        recording = server.client.get(server.episodes(id)[0]["recording"])
        assert recording.status_code == 200 and len(recording.content) > 1000

        # The other one leaves when it is told to, and nothing of it stays.
        below = descendants(machines[1].pid)
        machines[1].send_signal(signal.SIGTERM)
        assert machines[1].wait(30) == 0
        until(lambda: gone(below), "the end of its processes", 10)
