"""The field's rule finds the experts' keyframes in what the simulator recorded."""

import numpy as np
import pytest

from hide_tasks import ALL_TASKS, suite
from hide_tasks.bullet.world import World
from hide_tasks.keyframes import Frame, Trajectory, discover, distinct
from hide_tasks.script import script

AWAY = 0.015  # m that an arm may be from where it was sent: touching things yield


def frames(*rows):
    """Rows of x, speed, opened."""
    return [Frame(np.array([x, 0, 1, 1, 0, 0, 0.0]), speed, o) for x, speed, o in rows]


@pytest.mark.parametrize("name", ALL_TASKS)
def test_the_fields_rule_finds_the_experts_keyframes(name):
    keyframes = []
    with World(suite.build(suite.episode(name, "val", 2))) as world:
        trajectory = Trajectory(world)
        world.camcorders = [trajectory]
        for _, keyframe in script(world.task):
            world.execute(keyframe)
            keyframes.append(keyframe)
    seen = trajectory.frames

    found = distinct(seen, discover(seen))

    assert [frame.opened for frame in found] == [k.opening >= 0.5 for k in keyframes]
    for frame, keyframe in zip(found, keyframes, strict=True):
        assert np.linalg.norm(frame.pose[:3] - keyframe.position) < AWAY


def test_a_keyframe_is_where_the_fingers_move_where_the_arm_stops_and_the_end():
    moving = [(x / 10, 1.0, True) for x in range(5)]
    stop = [(0.5, 0.0, True)] * 3
    on = [(0.6, 1.0, True), (0.7, 1.0, False), (0.8, 1.0, False), (0.9, 1.0, False)]

    assert discover(frames(*moving, *stop, *on)) == [5, 9, 11]


def test_a_long_wait_is_found_again_and_again_but_is_one_place():
    moving = [(x / 10, 1.0, True) for x in range(5)]
    wait = frames(*moving, *[(0.5, 0.0, True)] * 12, (0.6, 1.0, True), (0.7, 1.0, True))
    found = discover(wait)

    assert found == [5, 10, 15, 18]
    assert [round(frame.pose[0], 1) for frame in distinct(wait, found)] == [0.5, 0.7]
