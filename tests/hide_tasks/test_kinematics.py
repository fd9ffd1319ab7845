"""The arm's mathematics against PyBullet's own forward kinematics."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pybullet
import pybullet_data
import pytest
from numpy.typing import NDArray

from hide_tasks.bullet import kinematics
from hide_tasks.bullet.kinematics import HOME, LOWER, UPPER

Array = NDArray[np.float64]
Judge = Callable[[Array], Array]
PANDA = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
GRASPTARGET = 11
DOWN = np.diag([1.0, -1.0, -1.0])  # z out of the gripper points down
AHEAD = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # z points to +x


@pytest.fixture(scope="module")
def bullet_tip() -> Iterator[Judge]:
    """Where PyBullet puts the tip (4, 4)."""
    client = pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(
        PANDA, kinematics.BASE.tolist(), useFixedBase=True, physicsClientId=client
    )

    def tip(joints: Array) -> Array:
        for joint, angle in enumerate(joints):
            pybullet.resetJointState(robot, joint, angle, physicsClientId=client)
        state = pybullet.getLinkState(
            robot, GRASPTARGET, computeForwardKinematics=True, physicsClientId=client
        )
        transform = np.eye(4)
        transform[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
        transform[:3, 3] = state[4]
        return transform

    yield tip
    pybullet.disconnect(client)


def postures(count: int, seed: int) -> Array:
    """Random postures inside the limits."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 7))


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
    "any posture": lambda rng: kinematics.tip_pose(rng.uniform(LOWER, UPPER)),
}


def test_the_tip_is_where_bullet_puts_it(bullet_tip: Judge) -> None:
    for joints in postures(200, seed=1):
        assert np.abs(kinematics.tip_pose(joints) - bullet_tip(joints)).max() < 1e-6


def test_the_jacobian_is_the_derivative_of_the_tip() -> None:
    step = 1e-6
    for joints in postures(20, seed=2):
        jacobian, here = kinematics.jacobian(joints), kinematics.tip_pose(joints)
        for k in range(7):
            there = kinematics.tip_pose(joints + step * np.eye(7)[k])
            change = (there - here) / step
            spin = change[:3, :3] @ here[:3, :3].T
            expected = [*change[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
            assert np.allclose(jacobian[:, k], expected, atol=1e-5)


def test_poses_and_transforms_are_the_same_thing() -> None:
    for joints in postures(100, seed=3):
        transform = kinematics.tip_pose(joints)
        pose = kinematics.matrix_to_pose(transform)

        assert np.allclose(kinematics.pose_to_matrix(pose), transform, atol=1e-12)
        assert np.allclose(kinematics.pose_to_matrix([*pose[:3], *-3 * pose[3:]]), transform)


def test_home_is_the_posture_of_homes_pose() -> None:
    pose = kinematics.matrix_to_pose(kinematics.tip_pose(HOME))

    joints = kinematics.solve(pose)

    assert joints is not None
    assert np.abs(joints - HOME).max() < 1e-6


@pytest.mark.parametrize("kind", TARGETS)
def test_every_reachable_target_is_reached_exactly(kind: str, bullet_tip: Judge) -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        target = TARGETS[kind](rng)

        joints = kinematics.solve(kinematics.matrix_to_pose(target))

        assert joints is not None
        assert ((joints >= LOWER) & (joints <= UPPER)).all()
        reached = bullet_tip(joints)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 1e-5
        assert np.linalg.norm(reached[:3, :3] - target[:3, :3]) < 1e-4


def test_all_solutions_reach_the_pose_and_differ() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        target = top_down(rng, math.radians(50))

        found = kinematics.solutions(kinematics.matrix_to_pose(target))

        for i, joints in enumerate(found):
            assert np.abs(kinematics.tip_pose(joints) - target).max() < 1e-8
            assert all(np.abs(joints - other).max() > 1e-4 for other in found[:i])


def test_no_posture_of_a_pose_is_nearer_to_home_than_the_solution() -> None:
    def distance(joints: Array) -> float:
        return float(kinematics.WEIGHTS @ (joints - HOME) ** 2)

    for joints in postures(300, seed=6) * 0.4 + 0.6 * HOME:
        best = kinematics.solve(kinematics.matrix_to_pose(kinematics.tip_pose(joints)))

        assert best is not None
        bias = kinematics.WRIST_SIDE * abs(best[4] - joints[4])
        assert distance(best) <= distance(joints) + bias + 1e-6


def test_the_elbow_of_a_top_down_posture_is_up() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        joints = kinematics.solve(kinematics.matrix_to_pose(top_down(rng)))

        assert joints is not None
        assert kinematics.link_frames(joints)[4, 2, 3] > 1.1


def test_tracking_a_line_ends_at_the_solution_of_its_end() -> None:
    rng = np.random.default_rng(8)
    for _ in range(50):
        start, end = top_down(rng), top_down(rng)
        end[:3, :3] = start[:3, :3]
        joints = kinematics.solve(kinematics.matrix_to_pose(start))
        assert joints is not None

        for part in np.linspace(0, 1, 41)[1:]:
            pose = kinematics.matrix_to_pose((1 - part) * start + part * end)
            before, joints = joints, kinematics.track(pose, joints)
            assert joints is not None
            assert np.abs(joints - before).max() < 0.2

        assert np.abs(joints - kinematics.solve(pose)).max() < 1e-6


def test_a_small_change_of_the_pose_is_a_small_change_of_the_posture() -> None:
    rng = np.random.default_rng(9)
    for _ in range(100):
        pose = kinematics.matrix_to_pose(top_down(rng))
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
    with pytest.raises(ValueError, match="joints has shape"):
        kinematics.tip_pose([0.0])
    with pytest.raises(ValueError, match="quaternion that is not zero"):
        kinematics.pose_to_matrix([0.0] * 7)
