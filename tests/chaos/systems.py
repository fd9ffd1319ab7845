"""Whole systems whose parts may be killed: a server with workers of its own, or with a cluster."""

import contextlib
import importlib.util
import os
import signal
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Self

import pytest

from server.db import untouched
from server.settings import LEDGER
from tests.chaos.policies import DECIDING
from tests.chaos.slow_network import HOLDS
from tests.processes import alive, command
from tests.server.running import ROOT, RunningServer, until
from workers import checkpoint_cache
from workers.sandbox import bubblewrap
from workers.simulator_process import descendants

MOMENTS = ("before it starts", "in mid-episode", "between its result and the acknowledgement")
TASK = "push_button_times"
POLICIES = {name.lower(): f"tests.chaos.policies:{name}" for name in ("Steady", "Poison")}
PATIENCE = 240.0  # s; where nothing else runs, a few are enough
MEASURED = ("success", "exact", "failure", "decisions", "scene_hash", "final_state_hash", "digest")


class Lost(NamedTuple):
    """An attempt that came to nothing."""

    fence: int
    reason: str


class System:
    """One server that plays one shard at a time, and what belongs to it.

    Attributes:
        victims: what may be killed, by name.
        seen: every process of it that a test has looked at.
    """

    engine = "pebble"
    victims: tuple[str, ...] = ("policy", "simulator", "supervisor", "server")

    def __init__(self, folder: Path):
        self.folder, self.holds = folder, folder / "holds"
        self.holds.mkdir()
        self.seen: set[int] = set()
        self.server = RunningServer(
            folder / "data",
            "--allow-python",
            "--no-references",
            *self.options(),
            workers=self.workers,
            program="tests.chaos.slow_network",
        )
        self.environment = pytest.MonkeyPatch()
        self.environment.setenv(HOLDS, str(self.holds))
        self.environment.setenv(checkpoint_cache.FOLDER, str(folder / "checkpoints"))

    workers = 1

    @property
    def log(self) -> Path:
        """What the processes of workers print."""
        return self.server.data / "logs" / "workers.log"

    def options(self) -> list[str]:
        return []

    # --- its parts ---

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            stack.callback(self.end)
            self.server.start()
            self.start_rest()
            for name, target in POLICIES.items():
                spec = {"kind": "python", "target": target}
                self.server.post("/policies", {"name": name, "spec": spec})
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self.environment.undo()

    def start_rest(self) -> None:
        """Starts what is no part of the server."""

    def end(self) -> None:
        """Nothing of it is left, whatever a test has stopped."""
        self.release()
        left = self.tree() | {pid for pid in self.seen if alive(pid)}
        for top in self.tops():
            top.kill()
            top.wait()
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if hasattr(self.server, "client"):
            self.server.client.close()

    def tops(self) -> list[subprocess.Popen[bytes]]:
        """The processes that somebody has started."""
        return [self.server.process] if hasattr(self.server, "process") else []

    def tree(self) -> set[int]:
        """Every process that belongs to it now."""
        living = [top.pid for top in self.tops() if top.poll() is None]
        return {pid for top in living for pid in [top, *descendants(top)] if alive(pid)}

    def pid(self, victim: str) -> int | None:
        """The process that is called so, if it is there."""
        if victim in ("policy", "simulator"):
            return self._that_runs(f" workers.{victim}_host ")
        if victim == "supervisor":
            return self._that_runs("spawn_main")
        return self.top(victim).pid

    def top(self, victim: str) -> subprocess.Popen[bytes]:
        return {"server": self.server.process}[victim]

    def _that_runs(self, text: str) -> int | None:
        around = bubblewrap.program() or "-"
        for pid in sorted(self.tree()):
            said = command(pid)
            if text in said and not said.startswith(around):
                return pid
        return None

    def kill(self, victim: str) -> None:
        """Kills a part; one that somebody has started is started again, by nobody else."""
        pid = until(lambda: self.pid(victim), f"the {victim}", PATIENCE, every=0.005)
        self.seen |= self.tree()
        os.kill(pid, signal.SIGKILL)
        if victim == "server":
            self.server.process.wait()
            self.release()
            self.server.client.close()
            self.server.start(self.server.url.rpartition(":")[2])

    # --- what a test wants to happen ---

    def hold(self, name: str) -> None:
        """The next report of this kind is held back."""
        (self.holds / name).touch()

    def holding(self, name: str) -> None:
        """Waits until a report is held back."""
        until((self.holds / f"{name}.here").exists, f"a report at {name}", PATIENCE)

    def release(self) -> None:
        """Nothing is held back any more."""
        for file in self.holds.iterdir():
            file.unlink()

    def freeze(self, *pids: int) -> None:
        """Stops processes, as an overloaded machine does; a system that ends kills them."""
        self.seen |= set(pids)
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGSTOP)

    def thaw(self, *pids: int) -> None:
        """Lets them go on."""
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def ask(self, policy: str = "steady", episodes: int = 2, **wanted: Any) -> str:
        """A new evaluation's id."""
        wanted = {"policy": policy, "tasks": [TASK], "episodes": episodes} | wanted
        return str(self.server.post("/evaluations", wanted)["id"])

    def deciding(self) -> Callable[[], bool]:
        """Whether a policy was asked for an action since this was called."""
        before = self._decisions()
        return lambda: self._decisions() > before

    def _decisions(self) -> int:
        return self.log.read_text(errors="replace").count(DECIDING) if self.log.exists() else 0

    # --- what became of it ---

    def finished(self, evaluation: str) -> dict[str, Any]:
        """An evaluation, once it has ended and nothing runs that does not belong here."""
        done = self.server.finished(evaluation, PATIENCE)
        self.seen |= self.tree()
        until(lambda: not self.orphans(), "the end of all that was left behind", 60.0)
        return done

    def orphans(self) -> set[int]:
        """Processes that were part of it, live, and are not part of it any more."""
        return {pid for pid in self.seen - self.tree() if alive(pid)}

    def scores(self, evaluation: str) -> dict[int, tuple[Any, ...]]:
        """What was measured of the final episodes, by index."""
        fields = ", ".join(MEASURED)
        wanted = f'SELECT "index", {fields} FROM episodes WHERE evaluation_id = ? AND '
        rows = self._rows(f"{wanted} state = 'final'", evaluation)
        return {index: tuple(measured) for index, *measured in rows}

    def committed(self) -> dict[str, tuple[Any, ...]]:
        """Every final episode of the ledger as it was committed, by id."""
        fields = ", ".join(("id", *MEASURED, "fence", "committed", "timing", "recording"))
        rows = self._rows(f"SELECT {fields} FROM episodes WHERE state = 'final'")
        return {id: tuple(kept) for id, *kept in rows}

    def lost(self, evaluation: str) -> list[Lost]:
        """The attempts that came to nothing."""
        found = self.server.get(f"/evaluations/{evaluation}/attempts")["items"]
        return [Lost(one["fence"], one["reason"]) for one in found if one["state"] == "lost"]

    def divergences(self) -> int:
        """How often an episode went differently the second time."""
        return int(self._rows("SELECT count(*) FROM divergences")[0][0])

    def litter(self) -> list[Path]:
        """Files of episodes that are not played any more."""
        data = self.server.data
        return [*(data / "growing").iterdir(), *(data / "blobs").glob("*.part")]

    def _rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        address = untouched(self.server.data / LEDGER)
        with contextlib.closing(sqlite3.connect(address, uri=True)) as opened:
            return opened.execute(query, values).fetchall()


class Cluster(System):
    """A server, a scheduler and a machine with one slot, as their users start them."""

    engine = "dask"
    victims = ("policy", "simulator", "supervisor", "worker", "scheduler", "server")
    workers = 0

    def __init__(self, folder: Path):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = str(free.getsockname()[1])
        super().__init__(folder)
        self.started: dict[str, subprocess.Popen[bytes]] = {}

    @property
    def log(self) -> Path:
        return self.folder / "processes.log"

    def options(self) -> list[str]:
        return ["--scheduler", f"tls://127.0.0.1:{self.port}"]

    def start_rest(self) -> None:
        for name in ("scheduler", "worker"):
            self.start(name)
        self.ready()

    def ready(self) -> None:
        """Waits until the machine is there."""
        workers = "/api/v1/health/ready"
        until(lambda: self.server.client.get(workers).json()["workers"] == 1, "the machine", 240)

    def start(self, name: str) -> None:
        """Starts the scheduler, or the machine, for the first time or again."""
        options = {
            "scheduler": ["--host", "127.0.0.1", "--port", self.port],
            "worker": ["--slots", "1", "--log", str(self.log)],
        }[name]
        with (self.folder / f"{name}.log").open("ab") as log:
            self.started[name] = subprocess.Popen(
                [sys.executable, "-m", "server.cli", name, self.server.url, *options],
                cwd=ROOT,
                stdout=log,
                stderr=log,
            )

    def tops(self) -> list[subprocess.Popen[bytes]]:
        return [*super().tops(), *self.started.values()]

    def top(self, victim: str) -> subprocess.Popen[bytes]:
        return self.started.get(victim) or super().top(victim)

    def kill(self, victim: str) -> None:
        super().kill(victim)
        if victim in self.started:
            self.started[victim].wait()
            self.start(victim)


SYSTEMS: dict[str, type[System]] = {one.engine: one for one in (System, Cluster)}


def cells(*parts: str, engine: str | None = None) -> list[Any]:
    """Parameters of a test: each engine, or one, with each of its parts that is named."""
    return [
        pytest.param(name, part, marks=marks_of(name))
        for name, kind in SYSTEMS.items()
        for part in parts
        if part in kind.victims and engine in (None, name)
    ]


def marks_of(engine: str) -> list[pytest.MarkDecorator]:
    """What holds for the tests of an engine: one worker of pytest-xdist runs all of them."""
    missing = engine == "dask" and importlib.util.find_spec("distributed") is None
    reason = "Dask is not installed: pip install 'hide-seek[dask]'"
    return [
        pytest.mark.xdist_group(f"chaos {engine}"),
        pytest.mark.skipif(missing, reason=reason),
    ]
