"""Jobs for workers: each is imported by name in another process."""

import os
import signal
import subprocess
import sys
import time
from multiprocessing.util import Finalize
from pathlib import Path


def square(number: int) -> int:
    return number * number


def own_pid(_: int) -> int:
    time.sleep(0.1)
    return os.getpid()


def surroundings(_: None) -> dict[str, str]:
    return {"threads": os.environ["OMP_NUM_THREADS"], "output": os.readlink("/proc/self/fd/1")}


def crash(_: None) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def fail_on_odd(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number


def die_the_first_time(job: tuple[str, bool]) -> None:
    mark, deadly = job
    if deadly and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)


def sleep_and_tell(job: tuple[float, str | None]) -> None:
    seconds, file = job
    if file:
        part = Path(f"{file}.part")
        part.write_text(str(os.getpid()))
        part.rename(file)
    time.sleep(seconds)


def parent_of_a_sleeper(file: str) -> None:
    """Has a child that sleeps, tells both processes, and ends its child when it is asked to end."""
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    Finalize(None, child.kill, exitpriority=0)
    sleep_and_tell((0.0, f"{file}.child"))
    Path(f"{file}.child").write_text(str(child.pid))
    sleep_and_tell((60.0, file))


def ignore_requests_to_end(file: str) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sleep_and_tell((60.0, file))


def act(what: str) -> None:
    """Does what it is called."""
    if what == "raise":
        raise ValueError(what)
    if what == "crash":
        crash(None)
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "sleep":
        time.sleep(60)


def append(file: str) -> None:
    with open(file, "a") as runs:
        runs.write("run\n")
    time.sleep(0.3)
