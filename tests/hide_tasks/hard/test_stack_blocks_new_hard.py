"""Blocks through the flap: what was inside before does not count, and all lie in their places."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.hard.stack_blocks_new_hard import EXTRAS, MOST

SPEC = suite.episode("stack_blocks_new_hard", "val", 0).twin({"count": 2, "extra": 1})


@pytest.fixture
def world():
    with World(suite.build(SPEC)) as world:
        world.scene.seats.clear()  # things are put elsewhere by hand here
        yield world


def post(world, block):
    """Let a block fall from the flap."""
    place = world.task.container.at[:3] + np.array([0, 0, world.task.container.rim])
    block.body.place(np.concatenate([place, [0, 0, 0, 1]]))
    world.settle()


def test_what_was_inside_before_is_not_counted(world):
    inside = sum(world.task.container.contains(b.position) for b in world.task.container.things)

    assert inside == MOST - 3
    assert world.task.hidden_state() == {"blocks_inside": 0}
    assert world.task.missing() is Failure.UNDERCOUNT


def test_the_right_number_succeeds_and_one_more_is_an_overcount(world):
    first, second, third = world.task.targets
    for block in (first, second):
        post(world, block)
    assert (world.success, world.violations) == (True, [])

    post(world, third)
    assert world.violations == [Failure.OVERCOUNT]


def test_a_posted_block_lies_where_its_twin_has_it_from_the_start(world):
    post(world, world.task.targets[0])
    fewer = suite.build(SPEC.twin({"extra": 0}))

    for block, twin in zip(world.task.container.things, fewer.container.things, strict=True):
        assert np.allclose(block.pose()[:3], twin.at[:3], atol=0.002)


def test_a_block_on_the_closed_part_of_the_top_is_outside(world):
    box, block = world.task.container, world.task.targets[0]
    place = box.at[:3] + np.array([0.064, 0, box.rim + 0.026])
    block.body.place(np.concatenate([place, [0, 0, 0, 1]]))
    world.settle()

    assert world.task.hidden_state() == {"blocks_inside": 0}


@pytest.mark.parametrize("extra", EXTRAS)
def test_as_many_more_lie_about_as_the_history_says(extra):
    task = suite.build(SPEC.twin({"extra": extra}))

    assert len(task.targets) == 2 + extra
