"""Blocks into the container: too many, too few, a wrong or dropped one, a hand that stays."""

import itertools

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, grasp
from hide_tasks.script import script

SPEC = suite.episode("stack_blocks_new", "val", 0).twin({"count": 1})


@pytest.fixture
def world():
    with World(suite.build(SPEC)) as world:
        yield world


def inside(world, block, corner):
    """Put a block into a corner of the container."""
    place = world.task.container.at[:3] + np.array([0.034 * corner[0], 0.034 * corner[1], 0.031])
    block.body.place(np.concatenate([place, [0, 0, 0, 1]]))
    world.settle()


def test_the_right_count_and_a_withdrawn_arm_succeed(world):
    inside(world, world.task.targets[0], (1, 1))

    assert world.success
    assert world.violations == []


def test_one_block_too_many_is_an_overcount(world):
    inside(world, world.task.targets[0], (1, 1))
    inside(world, world.task.targets[1], (-1, -1))

    assert world.violations == [Failure.OVERCOUNT]
    assert Failure.OVERCOUNT in world.task.spoils


def test_an_empty_container_is_an_undercount(world):
    assert world.task.missing() is Failure.UNDERCOUNT


def test_a_hand_that_holds_the_next_block_is_not_done(world):
    inside(world, world.task.targets[0], (1, 1))
    for move in (above(world.task.targets[1]), grasp(world.task.targets[1])):
        world.execute(move())

    assert world.task.missing() is Failure.UNFINISHED


def test_an_arm_that_stays_at_the_container_is_not_withdrawn(world):
    for _, keyframe in itertools.islice(script(world.task), 5):
        world.execute(keyframe)

    assert world.task.checks()["count_inside"]
    assert not world.success
    assert world.task.missing() is Failure.NOT_WITHDRAWN


def test_a_block_of_the_other_colour_is_a_wrong_object(world):
    for move in (above(world.task.distractors[0]), grasp(world.task.distractors[0])):
        world.execute(move())

    assert world.violations == [Failure.WRONG_OBJECT]


def test_a_block_off_the_table_is_dropped(world):
    world.task.targets[2].body.place(np.array([1.2, 0, TABLE_TOP - 0.3, 0, 0, 0, 1]))
    world.settle()

    assert world.violations == [Failure.DROPPED_OBJECT]


def test_one_block_is_told_in_the_singular():
    task = type(suite.build(SPEC))

    assert task.wording({"count": 1, "color": "red"}).startswith("put 1 red block into")
    assert task.wording({"count": 2, "color": "red"}).startswith("put 2 red blocks into")
