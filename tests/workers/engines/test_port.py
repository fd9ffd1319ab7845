"""What the reconciler may rely on, whichever the engine."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests.processes import alive, gone, wait_for
from tests.workers.engines import misbehaviour
from workers.engines.engine import Ended, Engine
from workers.engines.local import LocalEngine


@contextmanager
def engine(function: Callable, **settings: object) -> Iterator[Engine]:
    with closing(LocalEngine(function, **{"workers": 1, **settings})) as running:
        yield running


def ended(engine: Engine, count: int, seconds: float = 20.0) -> list[Ended]:
    """The first so many that end."""
    found: list[Ended] = []

    def enough() -> bool:
        found.extend(engine.ended())
        return len(found) >= count

    wait_for(enough, f"{count} that ended", seconds)
    return found


def pid_in(file: Path) -> int:
    wait_for(file.exists, f"{file.name} of the job")
    return int(file.read_text())


def test_what_returned_has_ended_without_a_reason() -> None:
    woken = threading.Event()
    with engine(misbehaviour.square, on_ended=woken.set) as running:
        running.submit("one", 3, 30.0)

        assert woken.wait(20)
        assert running.ended() == [Ended("one", None, result=9)]
        assert (running.ended(), running.inventory()) == ([], set())


def test_each_key_ends_with_its_own_reason() -> None:
    with engine(misbehaviour.act, workers=2) as running:
        for what in ("return", "raise", "crash", "kill", "sleep"):
            running.submit(what, what, 1.0 if what == "sleep" else 30.0)

        reasons = {one.key: one.reason for one in ended(running, 5)}

    assert reasons == {
        "return": None,
        "raise": "ValueError: raise",
        "crash": "its process died with signal 11",
        "kill": "its process died with signal 9",
        "sleep": "took longer than 1 s",
    }


def test_a_process_that_stands_still_is_killed_when_its_time_is_over(tmp_path: Path) -> None:
    with engine(misbehaviour.sleep_and_tell) as running:
        running.submit("one", (60.0, str(tmp_path / "one")), 2.0)
        pid = pid_in(tmp_path / "one")

        os.kill(pid, signal.SIGSTOP)

        assert ended(running, 1) == [Ended("one", "took longer than 2 s")]
        assert not alive(pid)


def test_a_key_that_is_there_is_not_submitted_twice(tmp_path: Path) -> None:
    with engine(misbehaviour.append) as running:
        for _ in range(3):
            running.submit("one", str(tmp_path / "runs"), 30.0)
        ended(running, 1)
        running.submit("two", str(tmp_path / "runs"), 30.0)
        ended(running, 1)

    assert (tmp_path / "runs").read_text() == "run\n" * 2


def test_a_queued_key_that_is_cancelled_never_runs(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("one", "two")]
    with engine(misbehaviour.sleep_and_tell) as running:
        for file in files:
            running.submit(file.name, (60.0, str(file)), 90.0)
        first = pid_in(files[0])

        running.cancel("two")

        assert ended(running, 1, 1.0) == [Ended("two", "cancelled", cancelled=True)]
        assert running.inventory() == {"one"}
        assert alive(first) and not files[1].exists()


def test_a_running_key_that_is_cancelled_takes_its_children_with_it(tmp_path: Path) -> None:
    with engine(misbehaviour.parent_of_a_sleeper) as running:
        running.submit("one", str(tmp_path / "one"), 90.0)
        pids = [pid_in(tmp_path / "one"), pid_in(tmp_path / "one.child")]

        running.cancel("one")

        assert ended(running, 1, 1.0) == [Ended("one", "cancelled", cancelled=True)]
        wait_for(lambda: gone(pids), "the end of its processes", 2.0)


def test_queued_keys_survive_a_pool_that_broke() -> None:
    """Pebble gives up when a process dies while it has nothing to do."""
    with engine(misbehaviour.own_pid) as running:
        running.submit("first", 0, 30.0)
        [first] = ended(running, 1)
        os.kill(first.result, 9)
        for key in ("one", "two", "three"):
            running.submit(key, 0, 30.0)

        reasons = {one.key: one.reason for one in ended(running, 3)}

    assert set(reasons) == {"one", "two", "three"}
    # The process may have taken the first before it died.
    assert {reasons["two"], reasons["three"]} == {None}


def test_processes_that_cannot_start_are_a_reason_not_a_loop(tmp_path: Path) -> None:
    with engine(misbehaviour.square, log=tmp_path / "no" / "folder" / "log") as running:
        running.submit("one", 1, 30.0)

        [one] = ended(running, 1)

    assert one.reason is not None and one.reason.startswith("the pool broke")


@pytest.mark.parametrize("function", ["sleep_and_tell", "ignore_requests_to_end"])
def test_closing_kills_everything_quickly(tmp_path: Path, function: str) -> None:
    running = LocalEngine(getattr(misbehaviour, function), workers=2)
    files = [tmp_path / name for name in ("one", "two")]
    for file in files:
        job = str(file) if function == "ignore_requests_to_end" else (60.0, str(file))
        running.submit(file.name, job, 90.0)
    pids = [pid_in(file) for file in files]

    began = time.monotonic()
    running.close()

    assert time.monotonic() - began < 5.0
    assert gone(pids)
    with pytest.raises(RuntimeError, match="closed"):
        running.submit("three", None, 1.0)


def test_many_threads_may_use_it_at_once() -> None:
    with engine(misbehaviour.square, workers=2) as running:

        def submit(start: int) -> None:
            for number in range(start, start + 20):
                running.submit(str(number), number, 30.0)

        threads = [threading.Thread(target=submit, args=(start,)) for start in (0, 10, 20, 30)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        wait_for(lambda: not running.inventory(), "the end of all")

        results = {one.key: one.result for one in running.ended()}
    assert results == {str(number): number**2 for number in range(50)}
