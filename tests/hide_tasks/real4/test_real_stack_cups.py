"""What is special to the paper cups: how many stood around, and what goes wrong."""

import numpy as np

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.likeness import likeness
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import script

TWO = suite.episode("real_stack_cups", "val", 0).twin({"count": 2, "around": 5})


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


def after(spec, keyframes):
    with World(suite.build(spec)) as world:
        for (_, keyframe), _ in zip(script(world.task), range(keyframes), strict=False):
            world.execute(keyframe)
        return world.observe(), world.task.stacked


def test_a_cup_more_or_less_around_is_seen():
    four, five, six = (after(TWO.twin({"around": n}), 0)[0] for n in (4, 5, 6))

    assert not likeness(four, five).alike
    assert not likeness(five, six).alike


def test_the_second_cup_looks_like_the_first_where_one_fewer_stood_around():
    (last, one), (first, none) = after(TWO, 10), after(TWO.twin({"around": 4}), 4)

    assert likeness(last, first).alike
    assert (one, none) == (1, 0)


def test_one_cup_too_few_is_an_undercount():
    result, _ = play(TWO.twin({"count": 3}), Replay(recorded(TWO)))

    assert (result.success, result.failure) == (False, Failure.UNDERCOUNT)


def test_one_cup_too_many_is_an_overcount():
    with World(suite.build(TWO)) as world:
        for number, cup in enumerate(world.task.others[:3], start=1):
            nested = world.task.base.pose() + np.array([0, 0, number * 0.011, 0, 0, 0, 0])
            cup.body.place(nested)
            world.settle()

        assert (world.task.stacked, world.violations) == (3, [Failure.OVERCOUNT])


def test_a_held_cup_is_not_stacked():
    result, _ = play(TWO, Replay(recorded(TWO)[:10]))

    assert (result.success, result.failure) == (False, Failure.UNDERCOUNT)


def test_a_cup_in_another_than_the_middle_one_is_a_wrong_object():
    with World(suite.build(TWO)) as world:
        world.step()
        one, two = world.task.others[:2]
        one.body.place(two.pose() + np.array([0, 0, two.floor + 0.002, 0, 0, 0, 0]))
        world.settle()

        assert Failure.WRONG_OBJECT in world.violations
        assert world.task.stacked == 0


def test_a_cup_off_the_table_is_dropped():
    with World(suite.build(TWO)) as world:
        world.task.others[0].body.place(np.array([1.2, 0.0, 0.4, 0, 0, 0, 1]))
        world.settle()

        assert Failure.DROPPED_OBJECT in world.violations
