"""A tower of blocks: too high, too low, a wrong block, one on the floor, a hand that holds on."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, grasp

SPEC = suite.episode("stack_blocks", "val", 0).twin({"count": 2})


@pytest.fixture
def world():
    with World(suite.build(SPEC)) as world:
        yield world


def stack(world, *blocks):
    """Build the tower of these blocks."""
    for number, block in enumerate(blocks, 1):
        block.body.place(np.concatenate([world.task._level(number), [0, 0, 0, 1]]))
    world.settle()


def take(world, block):
    for move in (above(block), grasp(block)):
        world.execute(move())


def test_the_right_number_of_levels_succeeds(world):
    stack(world, *world.task.targets[:2])

    assert world.success
    assert world.violations == []


@pytest.mark.parametrize("order", [(1, 0), (3, 1), (2, 3)])
def test_the_blocks_of_the_colour_may_come_in_any_order(world, order):
    stack(world, *(world.task.targets[number] for number in order))

    assert world.success
    assert world.task._stacked() == 2


def test_one_level_too_many_is_an_overcount(world):
    stack(world, *world.task.targets[:3])

    assert world.violations == [Failure.OVERCOUNT]
    assert Failure.OVERCOUNT in world.task.spoils


def test_blocks_side_by_side_are_no_tower(world):
    for block, aside, number in zip(world.task.targets, (-0.036, 0.036), (1, 2), strict=False):
        place = world.task._level(number) + np.array([aside, 0, 0])
        block.body.place(np.concatenate([place, [0, 0, 0, 1]]))
    world.step()

    assert not world.success


def test_a_block_across_two_others_is_one_too_many(world):
    lower, upper = world.task._level(1), world.task._level(2)
    aside = np.array([0.027, 0, 0])
    places = [lower - aside, lower + aside, upper]
    for block, place in zip(world.task.targets, places, strict=False):
        block.body.place(np.concatenate([place, [0, 0, 0, 1]]))
    world.settle()

    assert world.violations == [Failure.OVERCOUNT]
    assert not world.success


def test_a_tower_that_stands_on_another_colour_is_an_undercount(world):
    stack(world, world.task.distractors[0], *world.task.targets[:2])

    assert not world.success
    assert world.task.missing() is Failure.UNDERCOUNT


def test_a_hand_that_holds_the_next_block_is_not_done(world):
    stack(world, *world.task.targets[:2])
    take(world, world.task.targets[2])

    assert not all(world.task.checks().values())
    assert world.task.missing() is Failure.UNFINISHED


def test_a_block_of_the_other_colour_is_a_wrong_object(world):
    take(world, world.task.distractors[0])

    assert world.violations == [Failure.WRONG_OBJECT]


def test_a_block_off_the_table_is_dropped(world):
    world.task.targets[3].body.place(np.array([1.2, 0, TABLE_TOP - 0.3, 0, 0, 0, 1]))
    world.settle()

    assert world.violations == [Failure.DROPPED_OBJECT]
