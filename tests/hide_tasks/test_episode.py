"""The loop: verdicts, budgets, failed plans, policies that go wrong."""

import json
import subprocess
import sys

import numpy as np
import pytest

from hide_tasks import load, suite
from hide_tasks.contract import Failure, Keyframe, MotionOutcome, Stop
from hide_tasks.episode import FURTHER, play
from hide_tasks.policies import Expert, Replay

PUSH = suite.episode("push_button_times", "val", 0)


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


def twice():
    return next(s for s in suite.episodes("push_button_times", "val") if s.variation["count"] == 2)


class Scripted:
    """Answers whatever it was given, one after the other."""

    def __init__(self, *answers):
        self.answers = answers

    def reset(self, instruction, policy_seed):
        self.left = iter(self.answers)

    def act(self, observation):
        answer = next(self.left, Stop())
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.mark.parametrize(
    ("answer", "failure"),
    [
        (
            {"kind": "keyframe", "position": (0.3, 0, float("nan")), "quaternion": (1, 0, 0, 0)},
            Failure.POLICY_INVALID,
        ),
        (np.zeros(3), Failure.POLICY_INVALID),
        (None, Failure.POLICY_INVALID),
        (RuntimeError("out of memory"), Failure.POLICY_ERROR),
    ],
)
def test_a_policy_that_goes_wrong_is_a_named_failure(answer, failure):
    result, records = play(PUSH, Scripted(answer))

    assert (result.success, result.failure, len(records)) == (False, failure, 0)
    assert result.detail


class Broken(Scripted):
    """Goes wrong outside `act`."""

    def __init__(self, where):
        super().__init__(*[Keyframe(position=(0.3, 0, 1.2), quaternion=(1, 0, 0, 0))] * 3)
        self.where = where

    def reset(self, instruction, policy_seed):
        super().reset(instruction, policy_seed)
        if self.where == "reset":
            raise KeyError("weights")

    def belief(self):
        if self.where == "belief":
            raise KeyError("counter")
        return 0


@pytest.mark.parametrize(
    ("where", "failure"),
    [
        ("reset", Failure.POLICY_ERROR),
        ("belief", Failure.POLICY_ERROR),
        ("what it believes", Failure.POLICY_INVALID),
    ],
)
def test_reset_and_belief_that_go_wrong_are_named_too(where, failure):
    assert play(PUSH, Broken(where))[0].failure is failure


def test_dense_actions_have_a_budget_of_rows():
    still = {"kind": "ee_delta", "chunk": [[0.0] * 6 + [1.0]] * 200}
    result, records = play(PUSH, Scripted(*[still] * 50))

    assert len(records) == -(-suite.row_budget("push_button_times") // 200)
    assert result.failure is Failure.UNDERCOUNT


def test_a_failed_plan_is_a_decision_that_does_not_move():
    away = Keyframe(position=(3.0, 0, 1), quaternion=(1, 0, 0, 0))
    result, records = play(PUSH, Scripted(away, away))

    assert [r.outcome for r in records[:2]] == [MotionOutcome.OUT_OF_REACH] * 2
    assert result.decisions == 3  # the failed ones and the stop: none ends the episode


def test_an_episode_that_ends_on_a_failed_plan_says_so():
    away = Keyframe(position=(3.0, 0, 1), quaternion=(1, 0, 0, 0), stop=True)
    result, _ = play(PUSH, Scripted(away))

    assert result.failure is Failure.UNREACHABLE_POSE


def test_one_press_too_many_is_final():
    above, press, *_ = actions = recorded(twice())
    result, _ = play(twice(), Replay([above, press, above, press, above, press, *actions]))

    assert (result.success, result.failure) == (False, Failure.OVERCOUNT)
    assert result.decisions == 6


def test_one_press_too_few_is_an_undercount():
    above, press, *_, withdraw = recorded(twice())
    result, _ = play(twice(), Replay([above, press, above, withdraw]))

    assert (result.success, result.failure) == (False, Failure.UNDERCOUNT)


def test_success_that_is_spoiled_later_is_success_but_not_exact():
    actions = recorded(twice())
    above, press, *_ = actions
    going_on = [*actions[:-1], actions[-1].model_copy(update={"stop": False})]
    result, _ = play(twice(), Replay([*going_on, above, press, above]))

    assert (result.success, result.exact, result.failure) == (True, False, Failure.OVERCOUNT)
    assert result.decisions == len(actions) + FURTHER


def test_in_parity_mode_success_ends_the_episode():
    actions = recorded(twice())
    above, press, *_ = actions
    going_on = [*actions[:-1], actions[-1].model_copy(update={"stop": False})]
    result, _ = play(twice(), Replay([*going_on, above, press, above]), rules="parity")

    assert (result.exact, result.decisions) == (True, len(actions))


def test_the_budget_ends_an_episode():
    here = Keyframe(position=(0.3, 0, 1.2), quaternion=(1, 0, 0, 0))
    result, records = play(PUSH, Scripted(*[here] * 100))

    assert len(records) == load("push_button_times").budget() == 25
    assert result.failure is Failure.UNDERCOUNT
    assert result.detail == f"The budget of {len(records)} decisions is spent."


def test_records_tell_the_hidden_state_after_every_decision():
    spec = twice()
    _, records = play(spec, Expert())

    assert [r.hidden["presses_done"] for r in records] == [0, 1, 1, 2, 2, 2]
    assert [e.name for r in records for e in r.events] == ["press", "press"]
    assert records[-1].success and not records[-2].success


REPEAT = """
import json, sys
from hide_tasks import suite
from hide_tasks.episode import play
from hide_tasks.policies import Expert
hashes = {}
for name in json.loads(sys.argv[1]):
    hashes[name] = play(suite.episode(name, "val", 2), Expert())[0].final_state_hash
print(json.dumps(hashes))
"""


def test_an_episode_repeats_bit_for_bit_in_another_process_and_order():
    names = ["push_button_times", "search_drawer", "reopen_drawer"]
    here = {n: play(suite.episode(n, "val", 2), Expert())[0].final_state_hash for n in names}
    there = subprocess.run(
        [sys.executable, "-c", REPEAT, json.dumps(names[::-1])],
        capture_output=True,
        text=True,
        check=True,
    )

    assert json.loads(there.stdout) == here
