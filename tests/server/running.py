"""A server as its users start it: a process of its own, with real workers."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import httpx

from tests import viewer_files
from tests.processes import command
from workers.simulator_process import descendants

ROOT = Path(__file__).parents[2]
TRAINED = "HIDE_SERVER_TRAINED"
START_LIMIT = 240.0  # s; on a busy machine a start takes a while


class RunningServer:
    """`hide serve` on a free port, stopped when the block is left.

    Args:
        program: the module that stands for `hide`.
        within: a command that runs it, and becomes it.
        trained: the folder of trained policies that come along; without it there are none.
    """

    def __init__(
        self,
        data: Path,
        *options: str,
        workers: int = 2,
        program: str = "server.cli",
        within: Sequence[str] = (),
        trained: Path | None = None,
    ):
        self.data = data
        self.trained = trained or data.with_name("no-trained")
        self._command = [*within, sys.executable, "-m", program, "serve", "--data", str(data)]
        self._command += ["--workers", str(workers), *options]

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.client.close()

    def start(self, port: str = "0") -> None:
        """Starts it and waits until it answers."""
        viewer_files.lay(self.data)
        log = self.data.with_name(f"{self.data.name}.log")
        with open(log, "wb") as output:
            self.process = subprocess.Popen(
                [*self._command, "--port", port],
                cwd=ROOT,
                env=os.environ | {TRAINED: str(self.trained)},
                stderr=output,
                stdout=output,
                stdin=subprocess.DEVNULL,
            )

        def address() -> str | None:
            assert self.process.poll() is None, log.read_text()
            found = re.search(r"http://[\d.]+:\d+", log.read_text())
            return found and found[0]

        self.url = until(address, "the server's address", START_LIMIT)
        self.client = httpx.Client(base_url=self.url, trust_env=False, timeout=30)

    def stop(self) -> None:
        """Asks it to stop, as Ctrl-C does, and waits."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(timeout=30)

    def kill(self) -> None:
        """A power cut."""
        self.process.kill()
        self.process.wait(timeout=30)
        self.client.close()

    def get(self, path: str, **query: Any) -> Any:
        """The document at a path of the API."""
        return self.client.get(f"/api/v1{path}", params=query).raise_for_status().json()

    def post(self, path: str, document: Any = None) -> Any:
        """What the API answers to a document."""
        return self.client.post(f"/api/v1{path}", json=document).raise_for_status().json()

    def episodes(self, evaluation: str) -> list[dict[str, Any]]:
        """Every episode of an evaluation, over all pages."""
        found, cursor = [], None
        while True:
            query = {"limit": 200} | ({"cursor": cursor} if cursor else {})
            page = self.get(f"/evaluations/{evaluation}/episodes", **query)
            found += page["items"]
            if not (cursor := page["next"]):
                return found

    def final(self, evaluation: str) -> int:
        """How many episodes are final."""
        return int(self.get(f"/evaluations/{evaluation}")["progress"]["final"])

    def finished(self, evaluation: str, seconds: float = 240.0) -> dict[str, Any]:
        """The evaluation once it has ended."""

        def ended() -> dict[str, Any] | None:
            found = self.get(f"/evaluations/{evaluation}")
            return found if found["ended"] else None

        return until(ended, f"the end of {evaluation}", seconds, every=0.5)

    @property
    def workers(self) -> list[int]:
        """The engine's processes: the supervisors."""
        below = descendants(self.process.pid)
        return [pid for pid in below if "spawn_main" in command(pid)]


def until(look: Callable[[], Any], what: str, seconds: float = 60.0, *, every: float = 0.05) -> Any:
    """What a look gives as soon as it gives something; seconds between two looks."""
    deadline = time.monotonic() + seconds
    while not (found := look()):
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(every)
    return found


def kill(pid: int) -> None:
    """The end of a process, without a chance to say anything."""
    os.kill(pid, signal.SIGKILL)
