"""Counting presses: one too many, one too few, another button, an arm that stays."""

import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.motion.buttons import above, press
from hide_tasks.policies import Expert, Replay

SPEC = next(s for s in suite.episodes("push_button_times", "val") if s.variation["count"] == 2)


@pytest.fixture(scope="module")
def actions():
    return [record.action for record in play(SPEC, Expert())[1]]


def verdict(*actions):
    result, _ = play(SPEC, Replay(actions))
    return result.success, result.failure


def test_one_press_too_many_and_one_too_few(actions):
    above, press, *_, withdraw = actions

    assert verdict(above, press, above, press, above, press) == (False, Failure.OVERCOUNT)
    assert verdict(above, press, above, withdraw) == (False, Failure.UNDERCOUNT)


def test_an_arm_that_stays_is_not_withdrawn(actions):
    assert verdict(*actions[:-1], Stop()) == (False, Failure.NOT_WITHDRAWN)


def test_another_button_is_the_wrong_object():
    with World(suite.build(SPEC)) as world:
        other = world.task.distractors[0]
        for verb in (above, press, above):
            world.execute(verb(other)())

        assert world.violations == [Failure.WRONG_OBJECT]
        assert not world.task.presses.total
