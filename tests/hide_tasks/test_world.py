"""The simulator as a policy meets it: dense actions, grasps, detents, pictures."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet import kinematics
from hide_tasks.bullet.world import World
from hide_tasks.contract import EEDelta, JointPosition, Keyframe, MotionOutcome
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import top_down
from hide_tasks.panda import HOME_POSE
from hide_tasks.script import script


@pytest.fixture
def world():
    with World(suite.build(suite.episode("search_drawer", "val", 0))) as world:
        yield world


def play(world, keyframes):
    for _, (_, keyframe) in zip(range(keyframes), script(world.task), strict=False):
        world.execute(keyframe)


def test_home_is_where_an_episode_starts(world):
    assert np.array_equal(world.robot.joints, kinematics.HOME)
    assert np.allclose(world.robot.tip_pose, HOME_POSE, atol=1e-9)


def test_joint_targets_are_reached_at_20_hz(world):
    goal = kinematics.HOME + np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.1, 0.3])
    rows = np.linspace(kinematics.HOME, goal, 11)[1:]
    chunk = [[*row, 1.0] for row in [*rows, *[goal] * 4]]
    motion = world.execute(JointPosition(chunk=chunk))

    assert (motion.outcome, motion.path) == (MotionOutcome.ARRIVED, "dense")
    assert np.abs(world.robot.joints - goal).max() < 0.005


def test_a_joint_target_far_away_moves_no_faster_than_the_robot_can(world):
    world.execute(JointPosition(chunk=[[2.0, 0, 0, -0.9, 0, 1.2, 0.8, 1.0]]))

    assert 0.1 < world.robot.joints[0] < 0.2  # 2.6 rad/s for a 20th of a second, and overshoot


def test_displacements_of_the_tip_add_up(world):
    before = world.robot.tip_pose
    world.execute(EEDelta(chunk=[[0.005, 0, -0.01, 0, 0, 0, 1.0]] * 10))

    moved = world.robot.tip_pose - before
    assert np.allclose(moved[:3], [0.05, 0, -0.10], atol=0.012)
    assert np.abs(moved[3:]).max() < 0.02


def test_posture_after_a_keyframe_does_not_depend_on_the_way(world):
    goal = Keyframe.at(top_down(np.array([0.25, -0.25, TABLE_TOP + 0.3])))
    aside = Keyframe.at(top_down(np.array([0.30, 0.10, TABLE_TOP + 0.5]), yaw=0.8))
    world.execute(goal)
    direct = world.robot.joints
    world.execute(aside)
    world.execute(goal)

    assert np.abs(world.robot.joints - direct).max() < 1e-9


def test_a_drawer_follows_the_hand_that_holds_it(world):
    play(world, 3)

    assert world.task.chest["top"].opening == pytest.approx(0.20, abs=2e-3)


def test_a_drawer_pushed_nearly_shut_shuts_exactly():
    spec = suite.episode("search_drawer", "val", 0).twin({"item_in": "bottom"})
    with World(suite.build(spec)) as world:
        play(world, 6)
        assert world.task.chest["top"].opening == 0.0


def test_only_one_drawer_opens_at_a_time():
    spec = suite.episode("reopen_drawer", "val", 0).twin({"origin": "top"})
    other = suite.episode("reopen_drawer", "val", 0).twin({"origin": "bottom"})
    with World(suite.build(other)) as elsewhere:
        pulling = []
        for _, keyframe in script(elsewhere.task):
            pulling.append(keyframe)
            elsewhere.execute(keyframe)
    with World(suite.build(spec)) as world:  # the top drawer stays open
        for keyframe in pulling[6:9]:
            world.execute(keyframe)
        assert world.task.chest["bottom"].opening < 0.02


def test_what_lies_in_a_shut_drawer_is_in_no_picture(world):
    world.observe()
    item = next(i for i, part in enumerate(world.parts) if part.name == "block/block")

    assert not (world.ids == item).any()


@pytest.mark.parametrize("level", ["top", "middle", "bottom"])
def test_what_lies_in_an_open_drawer_is_seen(level):
    spec = suite.episode("search_drawer", "val", 2).twin({"item_in": level})
    with World(suite.build(spec)) as world:
        item = next(i for i, part in enumerate(world.parts) if part.name == "block/block")
        for done, (_, keyframe) in enumerate(script(world.task)):
            if done and done % 7 == 4 and done > 7 * ("top", "middle", "bottom").index(level):
                break
            world.execute(keyframe)
        world.observe()
        seen = [(ids == item).sum() for ids in world.ids]

    assert sorted(seen)[-2] >= 30  # pixels, in two cameras at least


def test_depth_and_colour_agree_with_the_table(world):
    """The table's top, seen by every fixed camera, back-projects to its height."""
    observation = world.observe()
    table = next(i for i, part in enumerate(world.parts) if part.name == "table")
    for number, name in enumerate(("front", "left_shoulder", "right_shoulder")):
        view = observation.views[name]
        rows, columns = np.nonzero(world.ids[number] == table)
        pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
        rays = np.linalg.inv(view.intrinsics) @ pixels * view.depth[rows, columns]
        heights = (view.camera_to_world[:3, :3] @ rays + view.camera_to_world[:3, 3:])[2]
        assert np.median(np.abs(heights - TABLE_TOP)) < 2e-4
