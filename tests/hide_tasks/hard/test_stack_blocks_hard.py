"""A tower that sinks: the top looks the same at any height, and what is put there counts once."""

import itertools

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.hard.stack_blocks_hard import LEVEL
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, grasp, lift
from hide_tasks.poses import point
from hide_tasks.script import script

SPEC = suite.episode("stack_blocks_hard", "val", 0).twin({"count": 2, "extra": 1})


@pytest.fixture
def world():
    with World(suite.build(SPEC)) as world:
        world.scene.seats.clear()  # things are put elsewhere by hand here
        yield world


def put(world, block):
    """Let a block go on the top one."""
    block.body.place(np.concatenate([world.task._level(1), [0, 0, 0, 1]]))
    world.settle()


def test_a_block_that_is_put_on_sinks_until_it_is_the_top(world):
    block = world.task.targets[0]
    put(world, block)

    assert block.position[2] == pytest.approx(TABLE_TOP + LEVEL)
    assert world.task.hidden_state() == {"blocks_stacked": 1}


def test_the_right_number_succeeds_and_one_more_is_an_overcount(world):
    first, second, third = world.task.targets
    put(world, first)
    assert world.task.missing() is Failure.UNDERCOUNT

    put(world, second)
    assert (world.success, world.violations) == (True, [])

    put(world, third)
    assert world.violations == [Failure.OVERCOUNT]


def test_an_arm_that_stays_is_not_withdrawn(world):
    for _, keyframe in itertools.islice(script(world.task), 11):
        world.execute(keyframe)

    assert world.task.checks()["count_stacked"]
    assert (world.success, world.task.missing()) == (False, Failure.NOT_WITHDRAWN)


def test_a_block_beside_the_dispenser_does_not_count(world):
    block = world.task.targets[0]
    beside = point(world.task.dispenser.at, 0.09, 0, 0.03)
    block.body.place(np.concatenate([beside, [0, 0, 0, 1]]))
    world.settle()

    assert world.task.hidden_state() == {"blocks_stacked": 0}


def test_when_the_top_block_is_taken_away_the_next_comes_up(world):
    first, second, _ = world.task.targets
    for block in (first, second):
        put(world, block)
    for move in (above(second), grasp(second), lift(second)):
        world.execute(move())

    assert world.task.hidden_state() == {"blocks_stacked": 1}
    assert first.position[2] == pytest.approx(TABLE_TOP + LEVEL)


def test_blocks_deep_in_the_dispenser_have_not_fallen(world):
    buried = world.task.dispenser.things[world.task.dispenser.pile[0]]

    assert buried.position[2] < TABLE_TOP - 0.1
    assert world.task.violations() == []
