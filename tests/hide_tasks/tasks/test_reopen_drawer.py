"""Reopening a drawer: another one, out of turn, twice, not to the end."""

import pytest

from hide_tasks import suite
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay

SPEC = suite.episode("reopen_drawer", "val", 0)
CLOSED, PRESSED, OPENED = 4, 6, 9  # keyframes until so much is done
OTHER = next(level for level in ("top", "middle", "bottom") if level != SPEC.variation["origin"])


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


@pytest.fixture(scope="module")
def actions():
    return recorded(SPEC)


def verdict(*actions):
    result, _ = play(SPEC, Replay(actions))
    return result.success, result.failure


def test_another_drawer_is_a_wrong_recall(actions):
    elsewhere = recorded(SPEC.twin({"origin": OTHER}))

    wrong = verdict(*actions[:PRESSED], *elsewhere[PRESSED:])
    assert wrong == (False, Failure.WRONG_RECALL)


def test_the_button_before_its_turn_is_a_skipped_step(actions):
    press = actions[CLOSED:PRESSED]

    assert verdict(*press, *actions) == (True, Failure.SKIPPED_STEP)


def test_opening_before_the_press_is_a_skipped_step(actions):
    reopen = actions[PRESSED:]

    early = verdict(*actions[:CLOSED], *reopen[:3], Stop())
    assert early == (False, Failure.SKIPPED_STEP)


def test_pressing_twice_is_a_repeated_step(actions):
    above, press = actions[CLOSED:PRESSED]

    twice = verdict(*actions[:PRESSED], above, press, *actions[PRESSED:])
    assert twice == (True, Failure.REPEATED_STEP)


def test_stopping_on_the_way_is_unfinished(actions):
    assert verdict(*actions[:PRESSED], Stop()) == (False, Failure.UNFINISHED)
