"""Cups that sink into a tall one: the top looks the same, and what is put there counts once."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.hard.stack_cups_new_hard import LEVEL
from hide_tasks.layout import TABLE_TOP

SPEC = suite.episode("stack_cups_new_hard", "val", 0).twin({"number": "two", "extra": 1})


@pytest.fixture
def world():
    with World(suite.build(SPEC)) as world:
        world.scene.seats.clear()  # things are put elsewhere by hand here
        yield world


def put(world, cup):
    """Let a cup go in the top one."""
    cup.body.place(np.concatenate([world.task._place(0), [0, 0, 0, 1]]))
    world.settle()


def test_a_cup_that_is_put_in_sinks_until_it_is_the_top(world):
    cup = world.task.others[0]
    put(world, cup)

    assert cup.position[2] == pytest.approx(TABLE_TOP + LEVEL)
    assert world.task.hidden_state() == {"stacked": 1}


def test_the_right_number_succeeds_and_one_more_is_an_overcount(world):
    first, second, third = world.task.others
    put(world, first)
    assert world.task.missing() is Failure.UNDERCOUNT

    put(world, second)
    assert (world.success, world.violations) == (True, [])

    put(world, third)
    assert world.violations == [Failure.OVERCOUNT]


def test_a_cup_in_another_loose_one_is_a_wrong_object(world):
    one, other, _ = world.task.others
    nested = other.pose() + np.array([0, 0, other.floor + 0.002, 0, 0, 0, 0])
    world.step()
    one.body.place(nested)
    world.settle()

    assert world.violations == [Failure.WRONG_OBJECT]


def test_cups_deep_in_the_tall_one_have_not_fallen(world):
    for cup in world.task.others[:2]:
        put(world, cup)
    depths = [world.task.cups[number].position[2] for number in world.task.dispenser.pile]

    assert min(depths) < TABLE_TOP - 0.1
    assert world.violations == []
