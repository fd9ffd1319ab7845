"""Inverse kinematics against PyBullet's own forward kinematics."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from hide_tasks.bullet import frames, kinematics, transforms
from hide_tasks.bullet.joint_space import LOWER, UPPER
from hide_tasks.bullet.kinematics import HOME
from tests.hide_tasks.bullet_arm import Array, bullet_tip, postures

DOWN = np.diag([1.0, -1.0, -1.0])  # z out of the gripper points down
AHEAD = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # z points to +x


def rotation(axis: Array, angle: float) -> Array:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def at(position: Array, turned: Array) -> Array:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = turned, position
    return transform


def top_down(rng: np.random.Generator, tilt: float = 0.0) -> Array:
    """A tip (4, 4) above the table, any yaw to 90 degrees, tilted by up to `tilt` rad."""
    far = 0.42 - 0.12 * tilt
    position = rng.uniform([0.12, -0.22, 0.77], [far, 0.22, 1.05])
    yaw = rotation(np.array([0, 0, 1]), rng.uniform(-math.pi / 2, math.pi / 2))
    heading = rng.uniform(0, 2 * math.pi)
    axis = np.array([math.cos(heading), math.sin(heading), 0])
    return at(position, rotation(axis, rng.uniform(0, tilt)) @ yaw @ DOWN)


def horizontal(rng: np.random.Generator) -> Array:
    """A tip (4, 4) that points to +x, pitched down by 40 to 60 degrees, rolled by 0 or 90."""
    position = rng.uniform([0.15, -0.2, 0.84], [0.3, 0.2, 1.0])
    pitch = rotation(np.array([0, 1, 0]), math.radians(rng.uniform(40, 60)))
    roll = rotation(np.array([0, 0, 1]), rng.choice([0, math.pi / 2]))
    return at(position, pitch @ AHEAD @ roll)


TARGETS: dict[str, Callable[[np.random.Generator], Array]] = {
    "top-down": top_down,
    "tilted": lambda rng: top_down(rng, math.radians(50)),
    "horizontal": horizontal,
    "any posture": lambda rng: frames.tip_pose(rng.uniform(LOWER, UPPER)),
}


def test_home_is_the_posture_of_homes_pose() -> None:
    pose = transforms.matrix_to_pose(frames.tip_pose(HOME))

    joints = kinematics.solve(pose)

    assert joints is not None
    assert np.abs(joints - HOME).max() < 1e-6


@pytest.mark.parametrize("kind", TARGETS)
def test_every_reachable_target_is_reached_exactly(kind: str) -> None:
    rng = np.random.default_rng(4)
    with bullet_tip() as tip:
        for _ in range(100):
            target = TARGETS[kind](rng)

            joints = kinematics.solve(transforms.matrix_to_pose(target))

            assert joints is not None
            assert ((joints >= LOWER) & (joints <= UPPER)).all()
            reached = tip(joints)
            assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 1e-5
            assert np.linalg.norm(reached[:3, :3] - target[:3, :3]) < 1e-4


def test_all_solutions_reach_the_pose_and_differ() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        target = top_down(rng, math.radians(50))

        found = kinematics.solutions(transforms.matrix_to_pose(target))

        for i, joints in enumerate(found):
            assert np.abs(frames.tip_pose(joints) - target).max() < 1e-8
            assert all(np.abs(joints - other).max() > 1e-4 for other in found[:i])


def test_no_posture_of_a_pose_is_nearer_to_home_than_the_solution() -> None:
    def distance(joints: Array) -> float:
        return float(kinematics.WEIGHTS @ (joints - HOME) ** 2)

    for joints in postures(300, seed=6) * 0.4 + 0.6 * HOME:
        best = kinematics.solve(transforms.matrix_to_pose(frames.tip_pose(joints)))

        assert best is not None
        bias = kinematics.WRIST_SIDE * abs(best[4] - joints[4])
        assert distance(best) <= distance(joints) + bias + 1e-6


def test_the_elbow_of_a_top_down_posture_is_up() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        joints = kinematics.solve(transforms.matrix_to_pose(top_down(rng)))

        assert joints is not None
        assert frames.link_frames(joints)[4, 2, 3] > 1.1


def test_tracking_a_line_ends_at_the_solution_of_its_end() -> None:
    rng = np.random.default_rng(8)
    for _ in range(50):
        start, end = top_down(rng), top_down(rng)
        end[:3, :3] = start[:3, :3]
        joints = kinematics.solve(transforms.matrix_to_pose(start))
        assert joints is not None

        for part in np.linspace(0, 1, 41)[1:]:
            pose = transforms.matrix_to_pose((1 - part) * start + part * end)
            before, joints = joints, kinematics.track(pose, joints)
            assert joints is not None
            assert np.abs(joints - before).max() < 0.2

        assert np.abs(joints - kinematics.solve(pose)).max() < 1e-6


def test_a_small_change_of_the_pose_is_a_small_change_of_the_posture() -> None:
    rng = np.random.default_rng(9)
    for _ in range(100):
        pose = transforms.matrix_to_pose(top_down(rng))
        one = kinematics.solve(pose)
        pose[:3] += [1e-5, -1e-5, 1e-5]
        other = kinematics.solve(pose)

        assert one is not None
        assert other is not None
        assert np.abs(one - other).max() < 1e-3


@pytest.mark.parametrize(
    "pose",
    [
        [3.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0],  # too far
        [-0.26, -0.01, 0.8, 1.0, 0.0, 0.0, 0.0],  # inside the base
        [0.3, 0.0, math.nan, 1.0, 0.0, 0.0, 0.0],
        [0.3, 0.0, math.inf, 1.0, 0.0, 0.0, 0.0],
        [0.3, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0],
    ],
)
def test_an_impossible_pose_has_no_posture(pose: list[float]) -> None:
    assert kinematics.solve(pose) is None
    assert kinematics.solutions(pose) == []
    assert kinematics.track(pose, HOME) is None


def test_a_wrong_shape_is_told() -> None:
    with pytest.raises(ValueError, match=r"a pose has shape \(6,\), expected \(7,\)"):
        kinematics.solve([0.3, 0.0, 0.9, 1.0, 0.0, 0.0])
