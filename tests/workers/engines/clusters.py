"""Dask clusters for tests: a scheduler and machines, each in a process of its own, on loopback."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.processes import wait_for
from workers.engines.scheduler import SILENCE

ROOT = Path(__file__).parents[3]
SCHEDULER = """
import asyncio
from workers.engines.scheduler import schedule

async def main():
    ready = asyncio.get_running_loop().create_future()
    ready.add_done_callback(lambda told: print(told.result(), flush=True))
    await schedule("127.0.0.1", {port}, silence={silence}, ready=ready)

asyncio.run(main())
"""
MEMBER = """
import asyncio, os
from pathlib import Path
from workers.engines.member import take_part

if __name__ == "__main__":
    asyncio.run(take_part({address!r}, slots={slots}, log=Path(os.devnull), name={name!r}))
"""


class Cluster:
    """Its processes may be killed, stopped and started again by a test."""

    def __init__(self, folder: Path, silence: float = SILENCE):
        self.folder, self.silence = folder, silence
        self.port = 0
        self.members: list[subprocess.Popen[bytes]] = []
        self.start_scheduler()

    def start_scheduler(self) -> None:
        """Starts one, on the port of the one before."""
        self.scheduler = self._start(
            "scheduler", SCHEDULER.format(port=self.port, silence=self.silence)
        )
        log = self.folder / "scheduler.log"

        def told() -> bool:
            assert self.scheduler.poll() is None, log.read_text()
            return bool(re.search(r"tcp://127.0.0.1:(\d+)", log.read_text()))

        wait_for(told, "the scheduler", 120)
        found = re.search(r"tcp://127.0.0.1:(\d+)", log.read_text())
        assert found
        self.address, self.port = found[0], int(found[1])

    def join(self, slots: int = 1) -> subprocess.Popen[bytes]:
        """One more machine."""
        name = f"machine-{len(self.members)}"
        program = MEMBER.format(address=self.address, slots=slots, name=name)
        self.members.append(self._start(name, program))
        return self.members[-1]

    def _start(self, name: str, program: str) -> subprocess.Popen[bytes]:
        file = self.folder / f"{name}.py"
        file.write_text(program)
        with (self.folder / f"{name}.log").open("wb") as log:
            command = [sys.executable, file]
            return subprocess.Popen(
                command,
                cwd=ROOT,
                env={"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
                stdout=log,
                stderr=log,
            )

    def end(self) -> None:
        """Kills what is left."""
        for process in [*self.members, self.scheduler]:
            process.kill()
            process.wait()


@contextmanager
def cluster(folder: Path, *slots: int, silence: float = SILENCE) -> Iterator[Cluster]:
    """A cluster of machines with so many slots each."""
    found = Cluster(folder, silence)
    try:
        for count in slots:
            found.join(count)
        yield found
    finally:
        found.end()
