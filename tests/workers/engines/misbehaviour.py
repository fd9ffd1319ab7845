"""Jobs for workers: each is imported by name in another process."""

import os
import signal
import time
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
