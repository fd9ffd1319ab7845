"""The engine runs functions of the standard library in real processes, and some that misbehave."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.workers.engines import misbehaviour
from workers.engines.local import ATTEMPTS, Finished, LocalEngine, Lost


def outcomes(function: object, jobs: list, **settings: object) -> list:
    engine = LocalEngine(function, **{"workers": 2, "time_limit": 30.0, **settings})
    return list(engine.run(jobs))


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_every_job_is_finished_once_in_recycled_processes() -> None:
    done = outcomes(misbehaviour.square, list(range(20)), recycle_after=3)

    assert sorted((one.job, one.result) for one in done) == [(n, n * n) for n in range(20)]


def test_a_worker_has_one_thread_and_prints_to_its_log(tmp_path: Path) -> None:
    log = tmp_path / "log"

    [done] = outcomes(misbehaviour.surroundings, [None], log=log)

    assert done == Finished(None, {"threads": "1", "output": str(log)})


def test_a_crash_leaves_its_traceback_in_the_log(tmp_path: Path) -> None:
    log = tmp_path / "log"

    [*_, last] = outcomes(misbehaviour.crash, [None], workers=1, log=log)

    assert last == Lost(None, "its process died with signal 11", ATTEMPTS, final=True)
    assert "misbehaviour.py" in log.read_text()


def test_a_job_that_raises_is_tried_again_and_then_lost() -> None:
    done = outcomes(misbehaviour.fail_on_odd, [2, 3])

    assert Finished(2, 2) in done
    assert [one for one in done if isinstance(one, Lost)] == [
        Lost(3, "ValueError: 3 is odd", attempt, final=attempt == ATTEMPTS)
        for attempt in range(1, ATTEMPTS + 1)
    ]


def test_a_killed_process_costs_one_attempt(tmp_path: Path) -> None:
    jobs = [(str(tmp_path / name), name == "victim") for name in ("one", "victim", "two", "three")]

    done = outcomes(misbehaviour.die_the_first_time, jobs)

    assert {one.job for one in done if isinstance(one, Finished)} == set(jobs)
    assert [one.reason for one in done if isinstance(one, Lost)] == [
        "its process died with signal 9"
    ]


def test_a_job_that_hangs_is_killed() -> None:
    done = outcomes(misbehaviour.sleep_and_tell, [(60.0, None)], time_limit=0.3)

    assert [one.reason for one in done] == ["took longer than 0.3 s"] * ATTEMPTS


def test_a_worker_that_dies_between_two_jobs_does_not_stop_the_rest() -> None:
    engine = LocalEngine(misbehaviour.own_pid, workers=1, time_limit=30.0)
    run = engine.run(iter([0, 1, 2, 3, 4]))
    first = next(run)
    os.kill(first.result, 9)
    time.sleep(0.3)

    assert sorted(one.job for one in run if isinstance(one, Finished)) == [1, 2, 3, 4]


def test_leaving_the_loop_stops_the_processes(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    engine = LocalEngine(misbehaviour.sleep_and_tell, workers=2, time_limit=30.0)
    run = engine.run([(0.0, None), (60.0, str(pids))])
    next(run)
    while not pids.exists():
        time.sleep(0.01)

    run.close()

    assert not alive(int(pids.read_text()))


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_workers_do_not_outlive_a_killed_parent(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    program = (
        "from tests.workers.engines import misbehaviour as m\n"
        "from workers.engines.local import LocalEngine\n"
        "if __name__ == '__main__':\n"
        "    engine = LocalEngine(m.sleep_and_tell, workers=1, time_limit=99.0)\n"
        f"    list(engine.run([(60.0, {str(pids)!r})]))\n"
    )
    file = tmp_path / "program.py"
    file.write_text(program)
    parent = subprocess.Popen([sys.executable, file], env={**os.environ, "PYTHONPATH": os.getcwd()})
    while not pids.exists():
        time.sleep(0.01)

    parent.kill()
    parent.wait()

    deadline = time.monotonic() + 10
    while alive(int(pids.read_text())):
        assert time.monotonic() < deadline, "the worker is still there"
        time.sleep(0.05)
