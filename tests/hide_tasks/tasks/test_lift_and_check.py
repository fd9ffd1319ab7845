"""Lift and check: what is named when blocks are lifted twice, left about, mistaken or dropped."""

import math

import numpy as np

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, carry_over, grasp, grip_yaw, let_go, lift
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import compose, pose, quaternion, yaw_of
from hide_tasks.tasks.lift_and_check import LOOK

SPEC = suite.episode("lift_and_check", "val", 0)


def second():
    return SPEC.twin({"chip_under": "second"})


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


def carried(world, place, where):
    """Take a block somewhere and let it go there."""
    block = world.task.blocks[place]
    for move in (above(block), grasp(block), lift(block, LOOK)):
        world.execute(move())
    yaw = grip_yaw(block)
    for move in (carry_over(where, LOOK, yaw), let_go(where, yaw)):
        world.execute(move())


def test_a_block_lifted_twice_is_a_repeated_step():
    actions = recorded(second())
    result, _ = play(second(), Replay([*actions[:5], *actions]))

    assert (result.success, result.failure) == (True, Failure.REPEATED_STEP)


def test_stopping_before_the_chip_is_found_is_unfinished():
    result, _ = play(second(), Replay(recorded(second())[:5]))

    assert (result.success, result.failure) == (False, Failure.UNFINISHED)


def test_finding_the_chip_without_taking_its_block_away_is_not_placed():
    result, _ = play(second(), Replay([*recorded(second())[:8], Stop()]))

    assert (result.success, result.failure) == (False, Failure.NOT_PLACED)


def test_a_block_left_beside_its_place_when_the_next_is_lifted_is_a_skipped_step():
    with World(suite.build(second())) as world:
        block = world.task.blocks["first"]
        carried(world, "first", block.at[:3] + np.array([0.0, 0.0, 0.01]) + _aside(world))
        assert world.violations == []
        other = world.task.blocks["second"]
        for move in (above(other), grasp(other)):
            world.execute(move())

        assert world.violations == [Failure.SKIPPED_STEP]


def test_a_block_that_is_put_back_turned_stands_as_before():
    with World(suite.build(second())) as world:
        block = world.task.blocks["first"]
        for move in (above(block), grasp(block), lift(block, LOOK)):
            world.execute(move())
        world.execute(let_go(block.at[:3], grip_yaw(block) + math.pi / 5)())

        assert math.dist(block.position, block.at[:3]) < 0.001
        assert abs(yaw_of(block.pose()) - yaw_of(block.at)) % (math.pi / 2) < 0.02


def test_a_block_that_is_not_taken_cannot_be_marked():
    with World(suite.build(second())) as world:
        block = world.task.blocks["first"]
        block.body.place(compose(block.pose(), pose(0, 0, 0, quaternion(yaw=0.5))))
        world.step()

        np.testing.assert_allclose(block.pose(), block.at, atol=1e-6)


def test_a_look_under_a_block_counts():
    with World(suite.build(second())) as world:
        block = world.task.blocks["first"]
        for move in (above(block), grasp(block), lift(block, 0.012)):
            world.execute(move())

        assert world.task.hidden_state()["checked"] == ["first"]


def test_an_empty_block_in_the_region_is_a_wrong_object():
    with World(suite.build(second())) as world:
        carried(world, "first", world.task._goal())

        assert world.violations == [Failure.WRONG_OBJECT]
        assert not world.success


def test_the_right_block_off_the_table_is_dropped():
    with World(suite.build(SPEC.twin({"chip_under": "first"}))) as world:
        carried(world, "first", world.task._goal())
        world.task.target.body.place(np.array([1.2, 0.0, TABLE_TOP - 0.3, 0, 0, 0, 1]))
        world.settle()

        assert Failure.DROPPED_OBJECT in world.violations


def test_a_block_put_down_near_its_place_slides_onto_it():
    with World(suite.build(second())) as world:
        block = world.task.blocks["first"]
        at = block.at[:3] + np.array([0.006, -0.005, 0.002])
        carried(world, "first", at)

        assert np.abs(np.array(block.pose()) - block.at).max() < 1e-3


def _aside(world):
    """A free spot 6 cm from the first block."""
    here = world.task.blocks["first"].at
    others = [b.at for place, b in world.task.blocks.items() if place != "first"]
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    steps = [0.06 * np.array([np.cos(a), np.sin(a), 0.0]) for a in angles]
    return max(
        steps, key=lambda s: min(np.linalg.norm(here[:3] + s - other[:3]) for other in others)
    )
