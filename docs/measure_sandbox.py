"""Measures what a sandbox costs a policy's process: a start, and a decision.

Run it with: .venv/bin/python docs/measure_sandbox.py [STARTS] [DECISIONS]
"""

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from hide_tasks.contract import CAMERAS, CameraView, Observation
from workers.policy_process import PolicyProcess
from workers.sandbox.choice import Sandbox, offer

POLICY = "tests.workers.some_policies:Stays"


def observation() -> Observation:
    """As large as a real one: four views of 128 x 128."""
    view = CameraView(
        np.zeros((128, 128, 3), np.uint8), np.ones((128, 128), np.float32), np.eye(3), np.eye(4)
    )
    pose = np.array([0.2, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return Observation(dict.fromkeys(CAMERAS, view), pose, 1.0, np.zeros(7), "wait")


@contextmanager
def loaded(sandbox: Sandbox) -> Iterator[PolicyProcess]:
    """A policy that is ready for its first decision."""
    policy = PolicyProcess(POLICY, timeout=60.0, sandbox=sandbox)
    try:
        policy.reset("wait", 7)
        yield policy
    finally:
        policy.close()


def start(sandbox: Sandbox) -> tuple[float, float]:
    """Seconds until a policy is loaded, and the processor's seconds for that and its end."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with loaded(sandbox) as policy:
        taken = time.perf_counter() - began
        policy._connection.close()  # it ends by itself, and its processes' times are added up
        assert policy._process is not None
        policy._process.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return taken, used


def decisions(sandbox: Sandbox, count: int) -> list[float]:
    """Seconds that each decision took."""
    seen, taken = observation(), []
    with loaded(sandbox) as policy:
        for _ in range(count):
            began = time.perf_counter()
            policy.act(seen)
            taken.append(time.perf_counter() - began)
    return taken


def main(starts: int = 10, count: int = 300) -> None:
    """Prints a table; the sandboxes take turns, so that a busy machine is busy for all."""
    there = [one for one in Sandbox if not offer(one).missing]
    times: dict[Sandbox, list[tuple[float, float]]] = {one: [] for one in there}
    for _ in range(starts):
        for one in there:
            times[one].append(start(one))
    print("median (least) | start, s | start, processor's s | decision, ms")
    for one in there:
        taken = [1000 * each for each in decisions(one, count)]
        columns = [*zip(*times[one], strict=True), taken]
        print(one, *(f"{median(all):.2f} ({min(all):.2f})" for all in columns), sep=" | ")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
