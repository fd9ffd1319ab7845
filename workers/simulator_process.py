"""The supervisor's end of a simulator that lives in a process of its own.

The process is started when it is first needed, plays many episodes, and is killed with all its
descendants as soon as it fails or is late, so that no episode inherits another one's trouble.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from multiprocessing.util import Finalize
from pathlib import Path
from time import monotonic
from typing import Any, NoReturn

from pydantic import BaseModel, ConfigDict

from hide_tasks.contract import Rules
from workers import wire
from workers.engines.processes import THREAD_LIMITS
from workers.policy_process import LOAD_LIMIT, PolicyDied
from workers.protocol import AssignedEpisode, EpisodeCommit, HostedPolicy, PolicySpec, RemotePolicy
from workers.remote.target import OPEN_LIMIT, PATIENCE
from workers.sandbox.choice import Sandbox

STALL_LIMIT = 60.0  # s without a decision, besides what the policy may take
START_LIMIT = 120.0  # s until the first word of a simulator that is just starting
SEND_LIMIT = 10.0  # s for a request to be taken
RECYCLE_AFTER = 50  # episodes; the Rerun SDK keeps some memory of each recording
LONGEST_REASON = 500  # characters


class Play(BaseModel):
    """An episode to play, as the simulator is told."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    episode: AssignedEpisode
    policy: PolicySpec
    checkpoint: Path | None = None  # the file of a policy that is one
    policy_name: str  # as recordings name it
    rules: Rules = "hide"
    recordings: Path | None = None  # the folder for the recording; None: none is made
    sources: str | None = None  # hash of the code that must play it
    sandbox: Sandbox | None = None  # around the policy's process, if it has one
    hidden: tuple[Path, ...] = ()  # folders that a class must not see
    deaths: int = 0  # how often a signal has ended the policy's process in this episode
    allowed: tuple[str, ...] = ()  # where else than on the internet a remote policy may be

    def patience(self, decided: int | None) -> float:
        """Seconds until the next sign of life, after so many decisions; None: before the start."""
        if decided is None:
            opens = isinstance(self.policy, RemotePolicy)
            return START_LIMIT + (begin_limit(self.policy) if opens else 0.0)
        if not isinstance(self.policy, HostedPolicy):
            return STALL_LIMIT
        load = 0.0 if decided else begin_limit(self.policy) + self.policy.timeout  # and the reset
        return load + self.policy.timeout + STALL_LIMIT


def begin_limit(policy: PolicySpec) -> float:
    """Seconds that a policy may take before its first answer, besides what any answer may take."""
    if isinstance(policy, RemotePolicy):
        return PATIENCE + OPEN_LIMIT + policy.first_timeout
    return LOAD_LIMIT if isinstance(policy, HostedPolicy) else 0.0


class SimulatorFailure(Exception):
    """An episode could not be played, through no fault of a policy."""


class SimulatorProcess:
    """A simulator, played by `workers.simulator_host`.

    Start it from a thread that stays: on Linux the process ends with the thread that started it.
    """

    def __init__(self, *, recycle_after: int = RECYCLE_AFTER):
        self.recycle_after = recycle_after
        self._played = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: socket.socket
        # Runs at SIGTERM as well, which atexit does not.
        Finalize(None, self.kill, exitpriority=0)

    def play(
        self,
        request: Play,
        *,
        limit: float,
        decided: Callable[[int], None] | None = None,
    ) -> EpisodeCommit:
        """The finished episode, but for its recording's hash.

        Args:
            request: what to play.
            limit: seconds of wall time for all of it.
            decided: told how many decisions were made, as the episode goes on.

        Raises:
            SimulatorFailure: the simulator raised, died, stood still or took too long.
            PolicyDied: nothing is kept of the episode; the simulator is ready for the next.
        """
        self._make_ready()
        try:
            self._connection.settimeout(SEND_LIMIT)
            wire.send(self._connection, {"play": request.model_dump(mode="json")})
            commit = self._follow(request, limit, decided)
        except (EOFError, OSError):
            self._fail(self._cause_of_death())
        except PolicyDied:
            raise
        except BaseException:
            self.close()
            raise
        self._played += 1
        return commit

    def rest(self) -> None:
        """Ends the policy's process; the simulator stays for another policy."""
        if self._process:
            with contextlib.suppress(OSError):
                wire.send(self._connection, {"rest": {}})

    def kill(self) -> None:
        """Kills the process and its descendants, from whatever thread; play then fails."""
        process = self._process
        if process and process.returncode is None:
            for pid in [process.pid, *descendants(process.pid)]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

    def close(self) -> None:
        """Ends the process and all its descendants; the next episode starts another one."""
        if self._process:
            self.kill()
            self._connection.close()
            self._process.wait()
            self._process = None

    @property
    def pid(self) -> int | None:
        """The process, if there is one."""
        return self._process.pid if self._process else None

    def _make_ready(self) -> None:
        if self._process and (self._process.poll() is not None or self._worn()):
            self.close()
        if not self._process:
            self._start()

    def _worn(self) -> bool:
        return self._played >= self.recycle_after

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        command = [sys.executable, "-m", "workers.simulator_host", str(theirs.fileno())]
        with theirs:
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=_environment(),
                start_new_session=True,  # Ctrl-C in a terminal is the server's to handle
            )
        self._connection = ours
        self._played = 0

    def _follow(
        self, request: Play, limit: float, decided: Callable[[int], None] | None
    ) -> EpisodeCommit:
        deadline = monotonic() + limit
        number = None
        while True:
            patience = request.patience(number)
            [(kind, content)] = self._hear(deadline, patience, limit).items()
            if kind == "failed":
                self._fail(content)
            if kind == "died":
                raise PolicyDied(content)
            if kind == "played":
                return EpisodeCommit.model_validate(content)
            number = content
            if decided:
                decided(content)

    def _hear(self, deadline: float, patience: float, limit: float) -> dict[str, Any]:
        left = deadline - monotonic()
        try:
            message: dict[str, Any] = wire.receive(self._connection, within=min(left, patience))
            return message
        except TimeoutError:
            late = f"took longer than {limit:g} s"
            still = f"gave no sign of life for {patience:g} s"
            self._fail(f"the episode {late if left <= patience else still}")

    def _cause_of_death(self) -> str:
        assert self._process is not None
        try:
            code = self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            return "the simulator's process closed its connection"
        how = f"signal {-code}, {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f"the simulator's process died: {how}"

    def _fail(self, reason: str) -> NoReturn:
        self.close()
        raise SimulatorFailure(reason.splitlines()[-1][:LONGEST_REASON])


def descendants(pid: int) -> list[int]:
    """Children of a process, their children and so on; none where there is no /proc."""
    found: list[int] = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in map(int, file.read_text().split()):
                found += [child, *descendants(child)]
    return found


def _environment() -> dict[str, str]:
    path = os.pathsep.join(os.path.abspath(part) for part in sys.path)
    return {**os.environ, "PYTHONPATH": path, **dict.fromkeys(THREAD_LIMITS, "1")}
