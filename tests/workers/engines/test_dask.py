"""What the reconciler may rely on when the machines are a Dask cluster's, and some of them die."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests.processes import alive, gone, wait_for
from tests.workers.engines import misbehaviour
from tests.workers.engines.clusters import Cluster, cluster
from tests.workers.engines.test_port import ended, pid_in
from workers.engines.engine import Ended

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'hide-seek[dask]'")

from workers.engines.dask import DaskEngine

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One machine with two slots, for jobs that harm none but themselves."""
    with cluster(tmp_path_factory.mktemp("cluster"), 2) as found:
        yield found


@contextmanager
def engine(function: Callable, on: Cluster, slots: int, **settings: object) -> Iterator[DaskEngine]:
    with closing(DaskEngine(function, scheduler=on.address, **settings)) as running:
        wait_for(lambda: running.slots() == slots, "the machines", 120)
        yield running


def test_each_key_ends_with_its_own_reason(shared: Cluster) -> None:
    woken = threading.Event()
    with engine(misbehaviour.act, shared, 2, on_ended=woken.set) as running:
        for what in ("return", "raise", "crash", "kill", "sleep"):
            running.submit(what, what, 1.0 if what == "sleep" else 30.0)

        reasons = {one.key: one.reason for one in ended(running, 5, 90)}
        assert running.inventory() == set() and woken.is_set()

    assert reasons == {
        "return": None,
        "raise": "ValueError: raise",
        "crash": "its process died with signal 11",
        "kill": "its process died with signal 9",
        "sleep": "took longer than 1 s",
    }


def test_a_process_that_stands_still_is_killed_when_its_time_is_over(
    shared: Cluster, tmp_path: Path
) -> None:
    with engine(misbehaviour.sleep_and_tell, shared, 2) as running:
        running.submit("one", (60.0, str(tmp_path / "one")), 2.0)
        pid = pid_in(tmp_path / "one")

        os.kill(pid, signal.SIGSTOP)

        assert ended(running, 1, 60) == [Ended("one", "took longer than 2 s")]
        wait_for(lambda: not alive(pid), "its end", 15)


def test_a_key_that_is_there_is_not_submitted_twice(shared: Cluster, tmp_path: Path) -> None:
    with engine(misbehaviour.append, shared, 2) as running:
        for _ in range(3):
            running.submit("one", str(tmp_path / "runs"), 30.0)
        ended(running, 1, 60)

    assert (tmp_path / "runs").read_text() == "run\n"


def test_cancelled_keys_take_their_processes_with_them(shared: Cluster, tmp_path: Path) -> None:
    with engine(misbehaviour.parent_of_a_sleeper, shared, 2) as running:
        for key in ("one", "two", "queued"):
            running.submit(key, str(tmp_path / key), 90.0)
        pids = [pid_in(tmp_path / name) for name in ("one", "one.child")]
        other = pid_in(tmp_path / "two")

        running.cancel("queued")
        running.cancel("one")

        assert {one.key for one in ended(running, 2)} == {"one", "queued"}
        wait_for(lambda: gone(pids), "the end of its processes", 15.0)
        assert alive(other) and not (tmp_path / "queued").exists()
    wait_for(lambda: not alive(other), "the end of what a closed engine ran", 15.0)


def test_a_job_of_a_lost_machine_is_lost_and_not_run_again(tmp_path: Path) -> None:
    with (
        cluster(tmp_path, 1, 1) as machines,
        engine(misbehaviour.sleep_and_tell, machines, 2) as running,
    ):
        for key in ("one", "two"):
            running.submit(key, (120.0, str(tmp_path / key)), 150.0)
        pids = [pid_in(tmp_path / key) for key in ("one", "two")]
        (tmp_path / "one").unlink(), (tmp_path / "two").unlink()

        machines.members[0].kill()

        [lost] = ended(running, 1, 60)
        assert lost == Ended(lost.key, "its worker disappeared")
        wait_for(lambda: sum(map(alive, pids)) == 1, "the end of its process", 10)
        wait_for(lambda: running.slots() == 1, "one machine less")
        assert not (tmp_path / lost.key).exists()


def test_a_lost_scheduler_ends_all_and_is_found_again(tmp_path: Path) -> None:
    with (
        cluster(tmp_path, 1) as machines,
        engine(misbehaviour.sleep_and_tell, machines, 1) as running,
    ):
        running.submit("one", (120.0, str(tmp_path / "one")), 150.0)
        pid = pid_in(tmp_path / "one")

        machines.scheduler.kill()
        machines.scheduler.wait()

        [lost] = ended(running, 1, 60)
        assert lost.reason == "the scheduler lost it"
        wait_for(lambda: not alive(pid), "the end of its process", 60)
        wait_for(lambda: running.fault is not None, "what is wrong")

        machines.start_scheduler()
        machines.join()
        wait_for(lambda: running.slots() == 1 and not running.fault, "the new scheduler", 120)
        running.submit("two", (0.0, None), 30.0)
        assert ended(running, 1, 60) == [Ended("two", None)]


def test_a_machine_that_stands_still_does_not_hold_up_the_others(tmp_path: Path) -> None:
    with (
        cluster(tmp_path, 1, 1) as machines,
        engine(misbehaviour.sleep_and_tell, machines, 2) as running,
    ):
        os.kill(machines.members[0].pid, signal.SIGSTOP)
        for number in range(3):
            running.submit(str(number), (0.0, None), 30.0)

        done = ended(running, 2, 60)

        assert [one.reason for one in done] == [None, None]


def test_a_machine_that_stands_still_for_too_long_is_lost_with_what_it_runs(tmp_path: Path) -> None:
    with (
        cluster(tmp_path, 1, silence=4.0) as machines,
        engine(misbehaviour.sleep_and_tell, machines, 1) as running,
    ):
        running.submit("one", (120.0, str(tmp_path / "one")), 150.0)
        pid = pid_in(tmp_path / "one")

        os.kill(machines.members[0].pid, signal.SIGSTOP)

        assert ended(running, 1, 60) == [Ended("one", "its worker disappeared")]
        os.kill(machines.members[0].pid, signal.SIGCONT)
        wait_for(lambda: not alive(pid), "the end of what it ran", 60)
