"""Processes that a long program starts: they end with it, and its next start waits for them."""

import ctypes
import fcntl
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
PR_SET_PDEATHSIG = 1  # prctl(2)
PATIENCE = 120.0  # s that what was left behind has to end
START_LIMIT = 240.0  # s
Command = Sequence[str | Path]


class Failed(Exception):
    """Something that was started did not end well; the message is for the user."""


class Folder:
    """A folder that one program at a time works in, with what it starts."""

    def __init__(self, path: Path):
        self.path = path
        self.running: set[subprocess.Popen[bytes]] = set()  # that `hide` waits for
        self.stopped = False
        path.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(path / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        ends = time.monotonic() + PATIENCE
        while not self._taken():
            if time.monotonic() > ends:
                raise Failed(f"{path} is in use; one program at a time works in it.")
            time.sleep(0.2)

    def _taken(self) -> bool:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def started(self, command: Command, **how: object) -> subprocess.Popen[bytes]:
        """A process that holds the folder as well: a killed program's next start waits for it."""
        return subprocess.Popen(
            [str(part) for part in command],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            pass_fds=[self._lock],
            preexec_fn=_end_with_parent if sys.platform == "linux" else None,
            **how,
        )

    def hide(self, *arguments: str | Path | int, threads: int | None = None) -> None:
        """Runs a `hide` command to its end; what it says goes to standard error.

        Args:
            threads: that it may compute with; None: as many as it wants.

        Raises:
            Failed: its exit status is not 0.
            KeyboardInterrupt: it was told to stop, and has.
        """
        command = [sys.executable, "-m", "server.cli", *map(str, arguments)]
        environment = os.environ | ({"OMP_NUM_THREADS": str(threads)} if threads else {})
        process = self.started(command, stdout=subprocess.DEVNULL, env=environment)
        self.running.add(process)
        if self.stopped:
            process.send_signal(signal.SIGTERM)
        try:
            status = process.wait()
        except BaseException:
            process.send_signal(signal.SIGTERM)  # Ctrl-C has reached it already
            process.wait()
            raise
        finally:
            self.running.discard(process)
        if status:
            raise Failed(f"hide {' '.join(map(str, arguments))} ended with status {status}.")

    def stop(self) -> None:
        """Tells every `hide` command that runs, or will, to end."""
        self.stopped = True
        for process in list(self.running):
            process.send_signal(signal.SIGTERM)


def _end_with_parent() -> None:
    """SIGTERM, so that a training saves where it stands."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


@contextmanager
def server(folder: Folder, data: Path, workers: int | None) -> Iterator[str]:
    """The address of a server of one's own, for as long as it is needed.

    Raises:
        Failed: it does not start; the message has what it said last.
    """
    log = data.with_name("server.log")
    command: list[str | Path] = [sys.executable, "-m", "server.cli", "serve", "--data", data]
    command += ["--port", "0", "--no-references", "--no-smoke"]
    command += ["--workers", str(workers)] if workers else []
    with log.open("wb") as output:
        process = folder.started(command, stdout=output, stderr=output)
    try:
        yield _address(process, log)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    ends = time.monotonic() + START_LIMIT
    while time.monotonic() < ends:
        if found := re.search(r"http://[\d.]+:\d+", log.read_text(errors="replace")):
            return found[0]
        if process.poll() is not None:
            break
        time.sleep(0.1)
    raise Failed(f"The server did not start; {log} ends with: {log.read_text()[-500:].strip()}")
