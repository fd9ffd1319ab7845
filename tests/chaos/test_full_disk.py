"""A disk that is full: a file system of the server's own, small enough to be filled."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from server.settings import LEDGER
from tests.chaos.systems import PATIENCE, System
from tests.server.running import RunningServer, until

SIZE = "600m"  # somewhat more than the server keeps in reserve
SPARE = 20 * 2**20  # bytes below the reserve
A_WHILE = 3.0  # s
ASK = """
import json, sqlite3, sys
with sqlite3.connect(sys.argv[1], uri=True) as opened:
    print(json.dumps(opened.execute(sys.argv[2], sys.argv[3:]).fetchall()))
"""


def mounting(folder: Path) -> list[str]:
    """A command that runs another one with a new file system in a folder, for it alone."""
    program = f'mount -t tmpfs -o size={SIZE} tmpfs "$0" && exec "$@"'
    rights = [] if os.getuid() == 0 else ["--map-root-user"]
    return ["unshare", "--mount", *rights, "sh", "-c", program, str(folder)]


@cache
def cannot_mount() -> str:
    """Why a file system cannot be made here, if it cannot."""
    for program in ("unshare", "nsenter"):
        if not shutil.which(program):
            return f"{program} is not installed"
    tried = subprocess.run([*mounting(Path("/mnt")), "true"], capture_output=True, text=True)
    return tried.stderr.strip()


class OnSmallDisk(System):
    """A server of which everything is on a small disk."""

    def __init__(self, folder: Path):
        (folder / "data").mkdir()
        super().__init__(folder)
        self.server = RunningServer(
            folder / "data",
            "--allow-python",
            "--no-references",
            workers=1,
            within=mounting(folder / "data"),
        )

    def start_rest(self) -> None:
        """From here the disk is seen through the server's process."""
        self.server.data = Path(f"/proc/{self.server.process.pid}/root{self.server.data}")
        self.filler = self.server.data / "filler"

    def fill(self, left: int) -> None:
        """Leaves so many bytes, whatever others write meanwhile."""
        self.filler.unlink(missing_ok=True)
        with self.filler.open("wb", buffering=0) as file:
            for piece in (2**20, 2**12):
                with contextlib.suppress(OSError):  # there is no room for it
                    while shutil.disk_usage(self.server.data).free >= left + piece:
                        file.write(bytes(piece))

    def _rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        """As of every system, but by a process that sees the disk: SQLite resolves all links."""
        rights = [] if os.getuid() == 0 else ["--user", "--preserve-credentials"]
        within = ["nsenter", "--target", str(self.server.process.pid), "--mount", *rights]
        address = f"{(self.folder / 'data' / LEDGER).as_uri()}?mode=ro"
        asked = [sys.executable, "-I", "-c", ASK, address, query, *values]
        done = subprocess.run([*within, *asked], check=True, capture_output=True, text=True)
        return [tuple(row) for row in json.loads(done.stdout)]

    def checks(self) -> dict[str, str]:
        """What the server says of itself."""
        return dict(self.server.client.get("/api/v1/health/ready").json()["checks"])


@pytest.fixture
def small(tmp_path: Path) -> Iterator[OnSmallDisk]:
    if why := cannot_mount():
        pytest.skip(f"a small disk cannot be had here: {why}")
    with OnSmallDisk(tmp_path) as system:
        yield system


def test_a_full_disk_loses_nothing_and_needs_nobody_once_there_is_room(small: OnSmallDisk) -> None:
    quiet = small.ask()
    assert small.finished(quiet)["state"] == "completed"
    kept = small.committed()

    # Too little is left for what would be measured: nothing more is handed out.
    small.fill(left=SPARE)
    waiting = small.ask()
    time.sleep(A_WHILE)
    found = small.server.get(f"/evaluations/{waiting}")
    assert (found["state"], found["progress"]["final"]) == ("queued", 0)
    assert small.checks()["disk"].startswith("full")

    # In mid-episode nothing at all is left: recording, ledger and log cannot be written.
    decides = small.deciding()
    small.filler.unlink()
    until(decides, "a decision", PATIENCE)
    small.fill(left=0)
    time.sleep(A_WHILE)
    assert small.checks()["disk"].startswith("full")
    assert kept.items() <= small.committed().items()

    small.filler.unlink()
    assert small.finished(waiting)["state"] == "completed"
    assert small.scores(waiting) == small.scores(quiet)
    assert kept.items() <= small.committed().items()
    assert small.lost(waiting) == []
    assert small.divergences() == 0 and small.litter() == []
    until(lambda: set(small.checks().values()) == {"ok"}, "the server's health")
