"""Spheres and boxes against PyBullet's collision hulls."""

import math
from collections.abc import Iterator

import numpy as np
import pybullet
import pybullet_data
import pytest
from numpy.typing import NDArray

from hide_tasks.bullet import collision, frames, kinematics, make_panda_spheres, transforms
from hide_tasks.bullet.collision import NOTHING, Obstacles
from hide_tasks.bullet.joint_space import LOWER, UPPER
from hide_tasks.bullet.kinematics import HOME

Array = NDArray[np.float64]
PANDA = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
FINGERS = (9, 10)
MOVING = (0, 1, 2, 3, 4, 5, 6, 8, 9, 10)  # Bullet's links that carry a hull, but for the base
OVERHANG = 0.04  # m that the spheres may stand out of the hulls (links 1 and 2)
TOP = 0.752


class Judge:
    """The Panda and boxes in PyBullet."""

    def __init__(self, boxes: Obstacles):
        self.client = pybullet.connect(pybullet.DIRECT)
        self.robot = pybullet.loadURDF(
            PANDA, frames.BASE.tolist(), useFixedBase=True, physicsClientId=self.client
        )
        self.boxes = [self._box(*box) for box in zip(*boxes, strict=True)]

    def _box(self, centre: Array, rotation: Array, half: Array) -> int:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=self.client
        )
        transform = np.eye(4)
        transform[:3, :3] = rotation
        return pybullet.createMultiBody(
            baseCollisionShapeIndex=shape,
            basePosition=centre.tolist(),
            baseOrientation=transforms.matrix_to_pose(transform)[3:].tolist(),
            physicsClientId=self.client,
        )

    def place(self, joints: Array, opening: float) -> None:
        angles = dict(enumerate(joints)) | dict.fromkeys(FINGERS, 0.04 * opening)
        for joint, angle in angles.items():
            pybullet.resetJointState(self.robot, joint, angle, physicsClientId=self.client)

    def nearest(self, body: int, link: int, other_link: int = -1) -> float:
        """Distance of a link from a link of a body, m; infinite beyond 10 cm."""
        points = pybullet.getClosestPoints(
            self.robot, body, 0.1, link, other_link, physicsClientId=self.client
        )
        return min((point[8] for point in points), default=math.inf)

    def distance(self, joints: Array, opening: float) -> float:
        self.place(joints, opening)
        return min(self.nearest(box, link) for box in self.boxes for link in MOVING)

    def touches_itself(self, joints: Array) -> bool:
        self.place(joints, 1.0)
        pairs = [(a, b) for a in (5, 6, 8, 9, 10) for b in (-1, 0, 1)]
        return any(self.nearest(self.robot, a, b) < 0 for a, b in pairs)


def turned(rng: np.random.Generator) -> Array:
    """A random rotation (3, 3)."""
    return transforms.pose_to_matrix([0, 0, 0, *rng.normal(size=4)])[:3, :3]


def clutter(seed: int, count: int = 12) -> Obstacles:
    """A table top and boxes at any place and angle around the arm."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform([-0.1, -0.45, 0.8], [0.6, 0.45, 1.3], (count, 3))
    halves = rng.uniform(0.01, 0.06, (count, 3))
    centres[0], halves[0] = (0.2, 0.0, TOP - 0.03), (0.5, 0.5, 0.03)
    rotations = np.array([np.eye(3), *(turned(rng) for _ in range(count - 1))])
    return Obstacles(centres, rotations, halves)


def box(centre: tuple[float, float, float], half: tuple[float, float, float]) -> Obstacles:
    return Obstacles(np.array([centre]), np.eye(3)[None], np.array([half]))


def posture(x: float, y: float, z: float) -> Array:
    """The arm with the gripper straight down and the fingers closing along y."""
    joints = kinematics.solve([x, y, z, 1.0, 0.0, 0.0, 0.0])
    assert joints is not None
    return joints


@pytest.fixture(scope="module")
def empty_judge() -> Iterator[Judge]:
    judge = Judge(NOTHING)
    yield judge
    pybullet.disconnect(judge.client)


@pytest.mark.parametrize("seed", range(4))
def test_no_touch_is_missed_and_few_are_imagined(seed: int) -> None:
    boxes = clutter(seed)
    judge, rng, imagined = Judge(boxes), np.random.default_rng(seed), 0
    for _ in range(150):
        joints, opening = rng.uniform(LOWER, UPPER), rng.choice([0.0, 0.5, 1.0])

        ours = collision.clearance(joints, opening, boxes)
        theirs = judge.distance(joints, opening)

        if theirs > 0:
            assert ours <= theirs + 1e-6
            assert ours >= min(theirs, 0.1) - OVERHANG
            imagined += ours < 0
        else:
            assert ours < 0
    assert imagined <= 10
    pybullet.disconnect(judge.client)


@pytest.mark.parametrize("part", make_panda_spheres.PARTS, ids=lambda part: part[0])
def test_every_corner_of_a_link_is_in_a_sphere(part: tuple[str, int, tuple[int, ...]]) -> None:
    name, frame, _ = part
    first, last = collision.body().starts[frame : frame + 2]
    spheres = collision.body().spheres[first:last]

    gaps = make_panda_spheres.gaps(make_panda_spheres.vertices(name), spheres)

    assert gaps.min(1).max() < 0


def test_an_open_gripper_is_wider_than_a_shut_one() -> None:
    joints, beside = posture(0.3, 0.0, 1.0), box((0.3, 0.07, 1.0), (0.005, 0.01, 0.005))

    assert collision.clearance(joints, 0.0, beside) > 0.02
    assert collision.clearance(joints, 1.0, beside) < 0


def test_a_box_between_the_open_fingers_is_free() -> None:
    joints, between = posture(0.3, 0.0, 1.0), box((0.3, 0.0, 1.0), (0.025, 0.025, 0.025))

    assert not collision.collides(joints, collision.body(1.0), between)
    assert collision.collides(joints, collision.body(0.5), between)


def test_what_is_held_counts() -> None:
    joints, below = posture(0.3, 0.0, 1.0), box((0.3, 0.0, 0.85), (0.05, 0.05, 0.01))
    ball = np.array([[0.0, 0.0, 0.1, 0.045]])

    assert collision.clearance(joints, 1.0, below) > 0.1
    assert collision.clearance(joints, 1.0, below, ball) == pytest.approx(-0.005, abs=1e-6)
    assert collision.collides(joints, collision.body(1.0, ball), below)


def test_the_boxes_that_are_touched_are_named() -> None:
    joints, table, far = (
        posture(0.3, 0.0, TOP + 0.012),
        clutter(0, count=1),
        box((2, 0, 0), (1,) * 3),
    )
    both = Obstacles(*(np.concatenate(pair) for pair in zip(table, far, strict=True)))

    assert collision.touching(joints, 1.0, both).tolist() == [True, False]
    assert collision.touching(posture(0.3, 0.0, 0.9), 1.0, both).tolist() == [False, False]


def test_what_touches_at_the_start_is_tolerated_but_may_not_dig_in() -> None:
    table, arm = clutter(0, count=1), collision.body(1.0)
    start, deeper = posture(0.3, 0.0, TOP + 0.012), posture(0.3, 0.0, TOP)

    tolerance = collision.tolerance(start, arm, table)

    assert collision.collides(start, arm, table)
    assert not collision.collides(start, arm, table, tolerance)
    assert not collision.collides(posture(0.3, 0.05, TOP + 0.012), arm, table, tolerance)
    assert collision.collides(deeper, arm, table, tolerance)


def test_a_start_that_touches_nothing_tolerates_nothing() -> None:
    boxes, arm = clutter(0, count=1), collision.body(1.0)

    tolerance = collision.tolerance(HOME, arm, boxes)

    assert (tolerance == collision.MARGIN).all()


def test_usual_postures_do_not_touch_themselves() -> None:
    rng, arm = np.random.default_rng(1), collision.body(1.0)
    assert not collision.touches_itself(HOME, arm)
    for _ in range(100):
        joints = posture(*rng.uniform([0.05, -0.3, 0.77], [0.4, 0.3, 1.1]))
        assert not collision.touches_itself(joints, arm)


def test_an_arm_folded_into_its_base_touches_itself(empty_judge: Judge) -> None:
    rng, arm, folded, told = np.random.default_rng(2), collision.body(1.0), 0, 0
    for joints in rng.uniform(LOWER, UPPER, (1000, 7)):
        if empty_judge.touches_itself(joints):
            folded += 1
            told += collision.touches_itself(joints, arm)
    assert folded > 20
    assert told >= 0.9 * folded


def test_nothing_is_infinitely_far() -> None:
    assert collision.clearance(HOME, 1.0, NOTHING) == math.inf


def test_wrong_boxes_and_spheres_are_told() -> None:
    one = box((0, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match=r"half sizes has shape \(2, 3\), expected \(1, 3\)"):
        collision.clearance(HOME, 1.0, one._replace(half_sizes=np.ones((2, 3))))
    with pytest.raises(ValueError, match="held spheres must be finite"):
        collision.body(1.0, [[0.0, 0.0, math.nan, 0.1]])
