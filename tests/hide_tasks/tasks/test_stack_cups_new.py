"""What goes wrong when stacking cups, by name."""

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import script

ONE = suite.episode("stack_cups_new", "val", 0).twin({"number": "one"})
TWO = ONE.twin({"number": "two"})


@lru_cache
def recorded(number):
    return tuple(record.action for record in play(ONE.twin({"number": number}), Expert())[1])


def test_one_cup_too_many_is_final():
    result, _ = play(ONE, Replay(recorded("two")))

    assert (result.success, result.failure) == (False, Failure.OVERCOUNT)


def test_one_cup_too_few_is_an_undercount():
    result, _ = play(TWO, Replay(recorded("one")))

    assert (result.success, result.failure) == (False, Failure.UNDERCOUNT)


def test_a_cup_that_was_taken_out_again_does_not_count():
    with World(suite.build(ONE)) as world:
        task = world.task
        (one, two), away = task.others, task.others[0].pose()
        nested = task.base.pose() + np.array([0, 0, task.base.floor + 0.002, 0, 0, 0, 0])
        for cup, place in ((one, nested), (one, away), (two, nested)):
            cup.body.place(place)
            world.settle()

        assert (task.stacked, world.violations) == (1, [])


def test_a_hand_that_holds_another_cup_is_not_done():
    with World(suite.build(ONE)) as world:
        for action in recorded("two")[:8]:
            world.execute(action)

        assert world.task.missing() is Failure.UNFINISHED


def test_the_arm_must_withdraw():
    result, _ = play(ONE, Replay(recorded("one")[:-1]))

    assert (result.success, result.failure) == (False, Failure.NOT_WITHDRAWN)


def test_a_cup_in_another_than_the_named_one_is_a_wrong_object():
    with World(suite.build(ONE)) as world:
        task = world.task
        cup, other = task.others
        world.step()
        cup.body.place(other.pose() + np.array([0, 0, cup.floor + 0.002, 0, 0, 0, 0]))
        for _ in range(24):
            world.step()

        assert world.violations == [Failure.WRONG_OBJECT]
        assert task.stacked == 0


def test_stacked_cups_nest():
    with World(suite.build(TWO)) as world:
        for _, keyframe in script(world.task):
            world.execute(keyframe)
        heights = sorted(cup.position[2] for cup in (world.task.base, *world.task.others))

        assert world.task.stacked == 2
        for low, high in pairwise(heights):
            assert high - low == pytest.approx(world.task.base.floor, abs=0.002)


def test_a_cup_under_the_table_is_dropped():
    with World(suite.build(ONE)) as world:
        world.task.base.body.place(world.task.base.pose() - np.array([0, 0, 0.5, 0, 0, 0, 0]))

        assert Failure.DROPPED_OBJECT in world.task.violations()
