"""One episode as a worker plays it, with policies in processes of their own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hide_tasks.contract import Failure
from hide_tasks.suite import episode
from tests.workers.sandbox.usable import usable
from workers import simulator
from workers.policies import BuiltIn, Hosted, PolicyChoice, Surroundings
from workers.sandbox.choice import Sandbox
from workers.simulator import EpisodeJob, PlayedEpisode, play_episode

ROOT = Path(__file__).parents[2]
HOSTILE = Path(__file__).with_name("sandbox") / "hostile.py"
TASK = "push_button_times"


@pytest.fixture(autouse=True)
def _no_policy_stays() -> Iterator[None]:
    yield
    for policy in simulator._hosted.values():
        policy.close()
    simulator._hosted.clear()


def hosted(name: str, **surroundings: object) -> Hosted:
    return Hosted(f"tests.workers.some_policies:{name}", Surroundings(**surroundings))


def play(policy: PolicyChoice, index: int = 0, **fields: object) -> PlayedEpisode:
    return play_episode(EpisodeJob(episode(TASK, "test", index), policy, "mine", **fields))


@pytest.mark.parametrize(
    ("name", "failure", "detail"),
    [
        ("Stops", Failure.UNDERCOUNT, ""),
        ("Raises", Failure.POLICY_ERROR, "RuntimeError: no such thing as a cup"),
        ("Hangs", Failure.POLICY_TIMEOUT, "act took longer than 0.5 s"),
        ("Nonsense", Failure.POLICY_INVALID, "Not an action: str: "),
    ],
)
def test_what_a_researchers_policy_does_wrong_is_scored(
    tmp_path: Path, name: str, failure: Failure, detail: str
) -> None:
    log = tmp_path / "policy.log"

    result = play(hosted(name, timeout=0.5 if name == "Hangs" else 60.0, log=log)).result

    assert (result.failure, result.success) == (failure, False)
    assert result.detail.startswith(detail)
    assert bool(result.detail) == bool(detail)
    assert log.read_text().startswith(f"told: {result.instruction}, ")


def test_a_policy_that_died_plays_the_next_episode(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.chdir(tmp_path)

    policy = hosted("DiesOnce", sandbox=Sandbox.NONE)  # it writes
    details = [play(policy, index).result.detail for index in range(2)]

    assert details == ["the policy's process died: exit code 1", ""]


@pytest.mark.parametrize(
    ("name", "failure", "detail", "deaths"),
    [
        (
            "KillsItselfTwice",
            Failure.UNDERCOUNT,
            "(the policy's process had died 2 times before: signal 9, SIGKILL)",
            2,
        ),
        (
            "KillsItselfAlways",
            Failure.POLICY_ERROR,
            "the policy's process died: signal 9, SIGKILL "
            "(the policy's process had died 2 times before: signal 9, SIGKILL)",
            3,
        ),
    ],
)
def test_a_signal_starts_the_episode_afresh_and_the_third_is_scored(
    tmp_path: Path, monkeypatch, name: str, failure: Failure, detail: str, deaths: int
) -> None:
    monkeypatch.chdir(tmp_path)
    policy = Hosted(f"{HOSTILE}:{name}", Surroundings(sandbox=Sandbox.NONE))  # it counts in a file

    result = play(policy, recordings=tmp_path / "recordings").result

    assert (result.failure, result.detail) == (failure, detail)
    assert (tmp_path / "deaths").read_text() == str(deaths)
    assert [path.name for path in (tmp_path / "recordings").iterdir()] == [f"{TASK}-test-000.rrd"]


@pytest.mark.parametrize("sandbox", Sandbox)
def test_a_signal_is_told_from_an_error_in_every_sandbox(sandbox: Sandbox) -> None:
    policy = Hosted(f"{HOSTILE}:KillsItselfAtOnce", Surroundings(sandbox=usable(sandbox)))

    result = play(policy).result

    assert result.failure is Failure.POLICY_ERROR
    assert "had died 2 times before: signal 9, SIGKILL" in result.detail


def test_a_belief_stands_in_the_decisions() -> None:
    decisions = play(hosted("Stays"), rules="parity").decisions

    assert [d.belief and d.belief.stage_count for d in decisions] == list(range(1, 26))


def test_a_recording_has_its_name_in_the_result(tmp_path: Path) -> None:
    recorded = play(hosted("Stops"), recordings=tmp_path / "recordings").result
    bare = play(BuiltIn("noop")).result

    assert recorded.recording == f"recordings/{TASK}-test-000.rrd"
    assert (tmp_path / recorded.recording).stat().st_size > 10_000
    assert bare.recording is None
    assert 0.0 == bare.timing.recording < recorded.timing.recording < recorded.timing.total
