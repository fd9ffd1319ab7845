"""Episodes in a simulator process, and everything that may happen to it."""

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hide_tasks import suite
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert
from tests.processes import gone, wait_for
from workers.protocol import (
    AssignedEpisode,
    BuiltInPolicy,
    EpisodeCommit,
    PolicySpec,
    PythonPolicy,
    ReplayPolicy,
    measured_digest,
)
from workers.recording import properties_of
from workers.sandbox.choice import Sandbox
from workers.simulator_process import Play, SimulatorFailure, SimulatorProcess, descendants

SPEC = suite.episode("push_button_times", "test", 0)
EXPERT = BuiltInPolicy(name="expert")
LIMIT = 60.0


@pytest.fixture(scope="module")
def simulator() -> Iterator[SimulatorProcess]:
    """One that tests may break; the next test gets another process."""
    process = SimulatorProcess()
    yield process
    process.close()


def request(policy: PolicySpec = EXPERT, **fields: object) -> Play:
    episode = AssignedEpisode(id="e1", spec=SPEC, actions=fields.pop("actions", None))
    return Play(episode=episode, policy=policy, policy_name="mine", **fields)


def hosted(name: str, timeout: float = 20.0) -> PythonPolicy:
    return PythonPolicy(target=f"tests.workers.some_policies:{name}", timeout=timeout)


AT_ONCE = request(ReplayPolicy(evaluation="ev"), actions=())  # stops without a move


def test_an_episode_is_what_it_is_in_this_process(
    simulator: SimulatorProcess, tmp_path: Path
) -> None:
    heard: list[int] = []

    commit = simulator.play(request(recordings=tmp_path), limit=LIMIT, decided=heard.append)

    result, decisions = play(SPEC, Expert())
    assert commit.result.final_state_hash == result.final_state_hash
    assert list(commit.decisions) == decisions
    assert heard == list(range(result.decisions + 1))
    assert commit.digest == measured_digest(
        commit.result, commit.start, commit.decisions, commit.changes
    )
    assert commit.thumbnail is not None and commit.thumbnail.startswith(b"\xff\xd8")
    assert EpisodeCommit.model_validate_json(commit.model_dump_json()) == commit
    assert properties_of(tmp_path / f"{SPEC.name}.rrd")["policy"] == "mine"


def test_the_process_stays_for_the_next_episode_until_it_is_worn(
    simulator: SimulatorProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulator.play(AT_ONCE, limit=LIMIT)
    first = simulator.pid
    simulator.play(AT_ONCE, limit=LIMIT)
    second = simulator.pid
    monkeypatch.setattr(simulator, "recycle_after", 2)
    simulator.play(AT_ONCE, limit=LIMIT)

    assert first == second != simulator.pid
    assert first and gone([first])


def test_a_replay_repeats_its_actions(simulator: SimulatorProcess) -> None:
    result, decisions = play(SPEC, Expert())
    actions = tuple(record.action for record in decisions)

    commit = simulator.play(request(ReplayPolicy(evaluation="ev"), actions=actions), limit=LIMIT)

    assert commit.result.final_state_hash == result.final_state_hash


def test_a_policys_failure_is_a_result(simulator: SimulatorProcess) -> None:
    commit = simulator.play(request(hosted("Raises")), limit=LIMIT)

    assert commit.result.failure is Failure.POLICY_ERROR
    assert commit.result.detail == "RuntimeError: no such thing as a cup"


def test_a_policy_stays_until_the_simulator_rests(simulator: SimulatorProcess) -> None:
    simulator.play(request(hosted("Stops")), limit=LIMIT)
    first = descendants(simulator.pid or 0)  # the policy, and the sandbox around it
    simulator.play(request(hosted("Stops")), limit=LIMIT)
    second = descendants(simulator.pid or 0)

    simulator.rest()

    assert first and first == second
    wait_for(lambda: gone(first), "the policy's end", 5)
    assert simulator.play(request(hosted("Stops")), limit=LIMIT).result.decisions == 1


def test_a_killed_simulator_is_replaced(simulator: SimulatorProcess) -> None:
    def kill(_: int) -> None:
        os.kill(simulator.pid or 0, signal.SIGKILL)

    with pytest.raises(SimulatorFailure, match="died: signal 9, SIGKILL"):
        simulator.play(request(), limit=LIMIT, decided=kill)

    assert simulator.play(AT_ONCE, limit=LIMIT).result.decisions == 1


def test_a_simulator_that_died_in_between_is_replaced(simulator: SimulatorProcess) -> None:
    simulator.play(AT_ONCE, limit=LIMIT)
    process = simulator._process
    assert process
    process.kill()
    wait_for(lambda: process.poll() is not None, "its end", 5)

    assert simulator.play(AT_ONCE, limit=LIMIT).result.decisions == 1


def test_a_late_episode_is_killed_with_all_its_processes(simulator: SimulatorProcess) -> None:
    simulator.play(AT_ONCE, limit=LIMIT)
    pids = [simulator.pid or 0]

    def note() -> None:
        wait_for(lambda: len(descendants(pids[0])) >= 2, "the policy and its child", 10)
        pids.extend(descendants(pids[0]))

    noting = threading.Thread(target=note)
    noting.start()
    with pytest.raises(SimulatorFailure, match="the episode took longer than 3 s"):
        simulator.play(request(hosted("HangsWithAChild"), sandbox=Sandbox.NONE), limit=3.0)
    noting.join()

    assert len(pids) == 3
    wait_for(lambda: gone(pids), "the end of all", 5)


def test_a_simulator_that_stands_still_is_killed(
    simulator: SimulatorProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.simulator_process.STALL_LIMIT", 0.5)

    def halt(_: int) -> None:
        os.kill(simulator.pid or 0, signal.SIGSTOP)

    with pytest.raises(SimulatorFailure, match=r"gave no sign of life for 0\.5 s"):
        simulator.play(AT_ONCE, limit=LIMIT, decided=halt)

    assert simulator.pid is None


def test_what_the_simulator_raises_is_its_reason(simulator: SimulatorProcess) -> None:
    with pytest.raises(SimulatorFailure, match="came without actions; a replay needs them"):
        simulator.play(request(ReplayPolicy(evaluation="ev")), limit=LIMIT)
