"""Paths: free in PyBullet, straight where they can be, and without a memory of their start."""

import hashlib
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest
from numpy.typing import NDArray

from hide_tasks.bullet import collision, frames, kinematics, planner, transforms
from hide_tasks.bullet.collision import NOTHING, Obstacles
from hide_tasks.bullet.joint_space import LOWER, UPPER
from hide_tasks.bullet.kinematics import HOME
from hide_tasks.bullet.planner import PathKind, Plan, PlanFailure

Array = NDArray[np.float64]
PANDA = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
FINGERS = (9, 10)
MOVING = (0, 1, 2, 3, 4, 5, 6, 8, 9, 10)  # Bullet's links that carry a hull, but for the base
TOP = 0.752
WALL = (0.25, 0.0, TOP + 0.15), (0.2, 0.01, 0.15)  # between left and right, 30 cm high


def turn(angle: float) -> Array:
    """A rotation (3, 3) about the world's z axis."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def boxes(
    *placed: tuple[tuple[float, ...], tuple[float, ...]], yaws: Array | None = None
) -> Obstacles:
    """A table top and boxes of a centre and half sizes."""
    table = ((0.2, 0.0, TOP - 0.03), (0.5, 0.5, 0.03))
    centres, halves = zip(table, *placed, strict=True)
    rotations = [turn(yaw) for yaw in (np.zeros(len(placed)) if yaws is None else yaws)]
    return Obstacles(np.array(centres), np.array([np.eye(3), *rotations]), np.array(halves))


def clutter(seed: int) -> Obstacles:
    """A table with 14 upright boxes and a shelf."""
    rng = np.random.default_rng(seed)
    placed = []
    for _ in range(14):
        half = rng.uniform([0.015, 0.015, 0.02], [0.05, 0.05, 0.11])
        x, y = rng.uniform([0.05, -0.38], [0.5, 0.38])
        placed.append(((x, y, TOP + half[2]), tuple(half)))
    y = rng.uniform(-0.2, 0.2)
    placed += [((0.45, y, z), (0.1, 0.1, 0.006)) for z in (0.76, 0.88, 1.0)]
    placed += [((0.45, y + dy, 0.88), (0.1, 0.006, 0.125)) for dy in (-0.1, 0.1)]
    return boxes(*placed, yaws=np.append(rng.uniform(0, math.pi, 14), np.zeros(5)))


def down(x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    """A pose that points straight down; at yaw 0 the fingers close along y."""
    return np.array([x, y, z, math.cos(yaw / 2), math.sin(yaw / 2), 0.0, 0.0])


def random_pose(rng: np.random.Generator) -> Array:
    """A pose above the table, tilted a little."""
    x, y, z, yaw = rng.uniform([0.1, -0.3, 0.8, -1.5], [0.45, 0.3, 1.1, 1.5])
    pose = down(x, y, z, yaw)
    pose[3:] += rng.normal(scale=0.08, size=4)
    return pose


def solved(pose: Array) -> Array:
    joints = kinematics.solve(pose)
    assert joints is not None
    return joints


def planned(start: Array, pose: Array, world: Obstacles, **options: object) -> Plan:
    found = planner.plan(start, pose, world, **{"opening": 1.0} | options)
    assert isinstance(found, Plan), found
    return found


def deepest(path: Array, world: Obstacles) -> float:
    """The least distance from a box that PyBullet measures along a path, m, at most 0."""
    client = pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(
        PANDA, frames.BASE.tolist(), useFixedBase=True, physicsClientId=client
    )
    bodies, least = [_body(client, *box) for box in zip(*world, strict=True)], 0.0
    for joints in path:
        for joint, angle in (dict(enumerate(joints)) | dict.fromkeys(FINGERS, 0.04)).items():
            pybullet.resetJointState(robot, joint, angle, physicsClientId=client)
        for body in bodies:
            for point in pybullet.getClosestPoints(robot, body, 0.0, physicsClientId=client):
                least = min(least, point[8]) if point[3] in MOVING else least
    pybullet.disconnect(client)
    return least


def _body(client: int, centre: Array, rotation: Array, half: Array) -> int:
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=client
    )
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    return pybullet.createMultiBody(
        baseCollisionShapeIndex=shape,
        basePosition=centre.tolist(),
        baseOrientation=pybullet.getQuaternionFromEuler([0, 0, yaw]),
        physicsClientId=client,
    )


@pytest.mark.parametrize("seed", range(4))
def test_no_path_collides_in_bullet(seed: int) -> None:
    world, rng, joints, kinds = clutter(seed), np.random.default_rng(seed), HOME, set()
    for _ in range(40):
        found = planner.plan(joints, random_pose(rng), world, opening=1.0)
        if isinstance(found, PlanFailure):
            assert found is not PlanFailure.NO_PATH
            continue

        assert deepest(found.joints, world) > -0.001
        joints = found.joints[-1]
        kinds.add(found.kind)
    assert len(kinds) > 1


def test_paths_are_dense_and_join_start_and_goal() -> None:
    world, rng, joints = clutter(5), np.random.default_rng(5), HOME
    for _ in range(40):
        pose = random_pose(rng)
        found = planner.plan(joints, pose, world, opening=1.0)
        if isinstance(found, PlanFailure):
            continue

        tips = np.array([frames.tip_pose(q)[:3, 3] for q in found.joints])
        assert (found.joints[0] == joints).all()
        assert np.allclose(tips[-1], pose[:3], atol=1e-6)
        assert np.abs(np.diff(found.joints, axis=0)).max() <= 0.0301
        assert np.linalg.norm(np.diff(tips, axis=0), axis=1).max() <= 0.0105
        assert ((found.joints >= LOWER) & (found.joints <= UPPER)).all()
        joints = found.joints[-1]


def test_the_posture_at_a_pose_does_not_tell_how_it_was_reached() -> None:
    world, pose = clutter(0), down(0.15, 0.0, 1.05)
    ends = []
    for seed in range(6):
        rng, joints = np.random.default_rng(seed), HOME
        for _ in range(5):
            found = planner.plan(joints, random_pose(rng), world, opening=1.0)
            joints = joints if isinstance(found, PlanFailure) else found.joints[-1]

        ends.append(planned(joints, pose, world).joints[-1])

    assert np.ptp(ends, axis=0).max() == 0
    assert np.abs(ends[0] - solved(pose)).max() < 1e-6


def test_a_free_way_is_straight() -> None:
    start, goal = down(0.2, -0.2, 0.9), down(0.4, 0.2, 1.0, yaw=0.8)

    path, kind = planned(solved(start), goal, boxes())

    tips = np.array([frames.tip_pose(q)[:3, 3] for q in path])
    along = goal[:3] - start[:3]
    off = np.cross(tips - start[:3], along / np.linalg.norm(along))
    assert kind is PathKind.STRAIGHT
    assert np.abs(off).max() < 1e-3


def test_a_straight_way_leads_out_of_another_posture() -> None:
    pose, up = down(0.3, 0.1, 0.9), down(0.3, 0.1, 1.0)
    swung = solved(pose) + 0.3 * np.linalg.svd(frames.jacobian(solved(pose)))[2][-1]
    start = frames.tip_pose(swung)[:3, 3]

    path, kind = planned(swung, up, boxes())

    tips = np.array([frames.tip_pose(q)[:3, 3] for q in path])
    along = (up[:3] - start) / np.linalg.norm(up[:3] - start)
    assert kind is PathKind.STRAIGHT
    assert np.abs(np.cross(tips - start, along)).max() < 1e-3
    assert np.abs(path[-1] - solved(up)).max() < 1e-6


def test_another_posture_of_the_same_pose_swings_back() -> None:
    pose = down(0.3, 0.1, 0.9)
    swung = solved(pose) + 0.3 * np.linalg.svd(frames.jacobian(solved(pose)))[2][-1]
    same = transforms.matrix_to_pose(frames.tip_pose(swung))

    path, kind = planned(swung, same, boxes())

    tips = np.array([frames.tip_pose(q)[:3, 3] for q in path])
    assert kind is PathKind.STRAIGHT
    assert np.abs(tips - same[:3]).max() < 1e-3


def test_a_wall_is_gone_around() -> None:
    world, start, goal = boxes(WALL), solved(down(0.3, -0.2, 0.85)), down(0.3, 0.2, 0.85)

    path, kind = planned(start, goal, world)

    assert kind is not PathKind.STRAIGHT
    assert deepest(path, world) > -0.001


def test_collisions_can_be_ignored() -> None:
    world, start, goal = boxes(WALL), solved(down(0.3, -0.2, 0.85)), down(0.3, 0.2, 0.85)

    path, kind = planned(start, goal, world, ignore_collisions=True)

    assert kind is PathKind.STRAIGHT
    assert deepest(path, world) < -0.005


def test_what_is_held_does_not_touch_either() -> None:
    world, start, goal = boxes(WALL), solved(down(0.3, -0.25, 1.15)), down(0.3, 0.25, 1.15)
    rod = np.array([[0.0, 0.0, z, 0.02] for z in (0.02, 0.05, 0.08, 0.11)])

    bare = planned(start, goal, world)
    laden = planned(start, goal, world, held=rod)

    assert bare.kind is PathKind.STRAIGHT
    assert laden.kind is not PathKind.STRAIGHT
    assert min(collision.clearance(q, 1.0, world, rod) for q in laden.joints) > 0


def test_a_touch_at_the_start_does_not_bind_the_arm() -> None:
    world, start = boxes(), solved(down(0.3, 0.0, TOP + 0.01))

    path, kind = planned(start, down(0.3, 0.0, 0.9), world)

    assert collision.clearance(start, 1.0, world) < collision.MARGIN
    assert kind is PathKind.STRAIGHT
    assert deepest(path, world) > -0.001


def test_failures_are_told_apart() -> None:
    world = boxes(((0.3, 0.0, 0.85), (0.05, 0.05, 0.1)))

    assert planner.plan(HOME, down(0.9, 0, 0.9), world, opening=1.0) is PlanFailure.OUT_OF_REACH
    assert planner.plan(HOME, [math.nan] * 7, world, opening=1.0) is PlanFailure.OUT_OF_REACH
    assert planner.plan(HOME, down(0.3, 0, 0.9), world, opening=1.0) is (
        PlanFailure.GOAL_IN_COLLISION
    )


def test_a_closed_wall_leaves_no_path() -> None:
    front, back = ((0.55, 0.0, 1.6), (0.68, 0.005, 0.8)), ((-0.8, 0.0, 1.6), (0.41, 0.005, 0.8))
    world = boxes(front, back, ((-0.26, 0.0, 1.9), (1.0, 0.005, 0.5)))
    start = solved(down(0.1, -0.35, 0.95, yaw=-0.8))

    found = planner.plan(start, down(0.1, 0.35, 0.95, yaw=0.8), world, opening=1.0)

    assert found is PlanFailure.NO_PATH


def test_a_start_that_is_no_posture_is_told() -> None:
    with pytest.raises(ValueError, match="start must be finite"):
        planner.plan([math.nan] * 7, down(0.3, 0, 0.9), NOTHING, opening=1.0)


def test_a_chain_is_joined_when_straight_lines_lead_through_it() -> None:
    chain = [down(0.3, 0.0, 0.9), down(0.3, 0.0, 0.8), down(0.4, 0.1, 0.8)]

    assert planner.joined(chain)
    assert not planner.joined([*chain, down(0.9, 0.1, 0.8)])


def digest() -> str:
    """A hash of every path of a fixed sequence of goals."""
    world, rng, joints, total = clutter(1), np.random.default_rng(1), HOME, hashlib.sha256()
    for _ in range(25):
        found = planner.plan(joints, random_pose(rng), world, opening=1.0)
        if isinstance(found, Plan):
            joints = found.joints[-1]
            total.update(found.joints.tobytes())
    return total.hexdigest()


def test_another_process_finds_the_same_paths_to_the_bit() -> None:
    command = [sys.executable, "-c", "import test_planner; print(test_planner.digest())"]
    root = Path(planner.__file__).parents[2]
    path = f"{root}:{Path(__file__).parent}"

    output = subprocess.run(
        command, env={"PYTHONPATH": path, "PYTHONHASHSEED": "1"}, check=True, capture_output=True
    )

    assert output.stdout.decode().split()[-1] == digest() == digest()
