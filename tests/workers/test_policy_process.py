import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hide_tasks.contract import (
    CAMERAS,
    Belief,
    CameraView,
    Failure,
    Keyframe,
    Observation,
    Policy,
    PolicyFailure,
    parse_action,
)
from tests.workers.sandbox.usable import usable
from workers.policy_process import NotStarted, PolicyProcess
from workers.sandbox.choice import Sandbox
from workers.sandbox.limits import MEMORY
from workers.simulator_process import descendants  # noqa: F401  (the program below has it)

POLICIES = "tests.workers.some_policies"


@contextlib.contextmanager
def playing(name: str, instruction: str = "wait", **settings: object) -> Iterator[PolicyProcess]:
    policy = PolicyProcess(
        f"{POLICIES}:{name}", **{"timeout": 20.0, "sandbox": Sandbox.NONE, **settings}
    )
    try:
        policy.reset(instruction, 7)
        yield policy
    finally:
        policy.close()


def observation() -> Observation:
    view = CameraView(
        np.zeros((8, 8, 3), np.uint8), np.ones((8, 8), np.float32), np.eye(3), np.eye(4)
    )
    pose = np.array([0.2, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return Observation(dict.fromkeys(CAMERAS, view), pose, 1.0, np.zeros(7), "wait")


@pytest.fixture(params=Sandbox)
def sandbox(request: pytest.FixtureRequest) -> Sandbox:
    """Each sandbox that this machine has; what it lacks is skipped, and says why."""
    return usable(request.param)


def pid(policy: PolicyProcess) -> int:
    assert policy._process is not None
    return policy._process.pid


def ended(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().split()[2] == "Z"


def test_an_action_and_a_belief_come_back(sandbox: Sandbox) -> None:
    with playing("Stays", sandbox=sandbox) as policy:
        assert isinstance(policy, Policy)
        action = parse_action(policy.act(observation()))

        assert action == Keyframe.at(observation().gripper_pose, opening=0.0)
        assert policy.belief() == Belief(stage_count=1)


def test_arrays_in_an_answer_are_an_action() -> None:
    with playing("Answers") as policy:
        action = parse_action(policy.act(observation()))

    assert action == Keyframe.at(observation().gripper_pose, ignore_collisions=True)


def test_one_process_plays_many_episodes(sandbox: Sandbox) -> None:
    with playing("Stays", sandbox=sandbox) as policy:
        first = pid(policy)
        policy.act(observation())
        policy.reset("again", 8)

        assert policy.belief() is None
        policy.act(observation())
        assert (pid(policy), policy.belief()) == (first, Belief(stage_count=1))


@pytest.mark.parametrize(
    ("instruction", "failure", "message"),
    [
        ("raise", Failure.POLICY_ERROR, "no such thing as a cup"),
        ("exit", Failure.POLICY_ERROR, "SystemExit: 3"),
        ("die", Failure.POLICY_ERROR, "the policy's process died: exit code 3"),
        ("abort", Failure.POLICY_ERROR, "the policy's process died: signal 6, SIGABRT"),
        ("sleep", Failure.POLICY_TIMEOUT, "act took longer than 0.5 s"),
        ("object", Failure.POLICY_INVALID, "object is neither a plain value"),
        ("believe", Failure.POLICY_INVALID, "belief: Input should be a valid integer"),
    ],
)
def test_what_goes_wrong_is_named(
    sandbox: Sandbox, instruction: str, failure: Failure, message: str
) -> None:
    with playing("Misbehaves", instruction, sandbox=sandbox) as policy:
        policy.timeout = 0.5 if instruction == "sleep" else 20.0
        before = pid(policy)

        with pytest.raises(PolicyFailure, match=message) as raised:
            policy.act(observation())

        assert raised.value.failure is failure
        assert "\n" not in str(raised.value)
        assert ended(before)


def test_a_process_that_stands_still_is_a_policy_that_is_late() -> None:
    """Nobody can tell it from one that thinks for too long."""
    with playing("Stays") as policy:
        policy.timeout, before = 0.5, pid(policy)
        os.kill(before, signal.SIGSTOP)

        with pytest.raises(PolicyFailure, match=r"act took longer than 0.5 s") as raised:
            policy.act(observation())

    assert raised.value.failure is Failure.POLICY_TIMEOUT
    assert ended(before)


def test_after_a_failure_the_next_episode_has_a_new_process(sandbox: Sandbox) -> None:
    with playing("Misbehaves", "raise", sandbox=sandbox) as policy:
        before = pid(policy)
        with pytest.raises(PolicyFailure):
            policy.act(observation())

        policy.reset("wait", 9)

        assert parse_action(policy.act(observation())).stop
        assert pid(policy) != before


def test_not_a_number_arrives_as_such_and_is_the_loops_to_judge() -> None:
    with playing("Misbehaves", "nan") as policy:
        assert np.isnan(policy.act(observation())["position"]).all()


def test_the_policy_hears_no_more_than_it_may(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(os.getcwd())
    monkeypatch.chdir(tmp_path)
    with playing("TellsAll", "close the drawer") as policy:
        policy.act(observation())
        process = pid(policy)

    told = json.loads((tmp_path / "told.json").read_text())
    assert (told["instruction"], told["policy_seed"], told["pid"]) == (
        "close the drawer",
        7,
        process,
    )
    assert told["observation"] == sorted(Observation.__dataclass_fields__)
    assert told["arguments"][1:] == [told["arguments"][1]]  # the number of its socket
    assert told["arguments"][1].isdigit()
    assert not {"pybullet", "numba", "hide_tasks.suite"} & set(told["modules"])


def test_what_a_policy_prints_goes_to_its_log(sandbox: Sandbox, tmp_path: Path) -> None:
    with playing("Stays", "close the drawer", log=tmp_path / "policy.log", sandbox=sandbox):
        assert (tmp_path / "policy.log").read_text() == "told: close the drawer, 7\n"


def test_a_class_in_a_file_may_import_its_neighbours(sandbox: Sandbox, tmp_path: Path) -> None:
    (tmp_path / "neighbour.py").write_text("from hide_tasks.contract import Stop\n")
    (tmp_path / "mine.py").write_text(
        "from neighbour import Stop\n"
        "class Mine:\n"
        "    def reset(self, instruction, policy_seed): pass\n"
        "    def act(self, observation): return Stop()\n"
    )
    policy = PolicyProcess(f"{tmp_path}/mine.py:Mine", timeout=20.0, sandbox=sandbox)
    try:
        policy.reset("wait", 7)

        assert policy.act(observation()) == {"kind": "stop", "stop": True}
    finally:
        policy.close()


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("no_such_module:Mine", "ModuleNotFoundError: No module named 'no_such_module'"),
        (f"{POLICIES}:Nobody", f"AttributeError: {POLICIES} has no class Nobody"),
        (f"{POLICIES}:NoAct", "TypeError: NoAct has no method act; a policy has reset and act"),
        ("no/such/file.py:Mine", "FileNotFoundError: no file no/such/file.py"),
    ],
)
def test_a_policy_that_cannot_be_loaded(sandbox: Sandbox, target: str, message: str) -> None:
    policy = PolicyProcess(target, timeout=20.0, sandbox=sandbox)

    with pytest.raises(PolicyFailure) as raised:
        policy.load()

    assert str(raised.value) == message


@pytest.mark.parametrize(
    ("memory", "message"),
    [("much", "expected a number of GiB"), ("0.001", "before it served; its sandbox was ")],
)
@pytest.mark.parametrize("closed", [Sandbox.BUBBLEWRAP, Sandbox.LANDLOCK])
def test_a_process_that_cannot_start_is_no_failure_of_its_policy(
    monkeypatch, closed: Sandbox, memory: str, message: str
) -> None:
    policy = PolicyProcess(f"{POLICIES}:Stays", timeout=20.0, sandbox=usable(closed))
    monkeypatch.setenv(MEMORY, memory)

    with pytest.raises(NotStarted, match=message):
        policy.make_ready()


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_busy_policy_does_not_outlive_its_parent(sandbox: Sandbox) -> None:
    program = (
        "from tests.workers.test_policy_process import *\n"
        "policy = PolicyProcess(\n"
        f"    '{POLICIES}:Misbehaves', timeout=60.0, sandbox=Sandbox('{sandbox}')\n"
        ")\n"
        "policy.reset('sleep', 7)\n"
        "print(pid(policy), *descendants(pid(policy)), flush=True)\n"
        "policy.act(observation())\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    with parent:
        assert parent.stdout is not None
        processes = [int(pid) for pid in parent.stdout.readline().split()]
        time.sleep(0.2)
        parent.kill()

    deadline = time.monotonic() + 5
    while not all(map(ended, processes)):
        assert time.monotonic() < deadline, "the policy is still there"
        time.sleep(0.02)
