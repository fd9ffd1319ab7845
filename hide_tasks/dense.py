"""The expert's motion in the dense action spaces: rows at 20 Hz, and a policy that plays them.

The script's keyframes are read as they are reached and carried out row by row, so whatever has
moved on the way is found where it is. The same motion stands in both spaces: every row is a step
of the tip and the joints that the step leads to, so either replays it, in chunks, without looking.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hide_tasks import suite
from hide_tasks.bullet import kinematics, obstacles, planner
from hide_tasks.bullet.executor import SUBSTEPS
from hide_tasks.bullet.frames import tip_pose
from hide_tasks.bullet.robot import SETTLED, timed
from hide_tasks.bullet.transforms import matrix_to_pose
from hide_tasks.bullet.world import World
from hide_tasks.contract import (
    Action,
    EEDelta,
    EpisodeSpec,
    JointPosition,
    Keyframe,
    Observation,
    Row,
    Stop,
)
from hide_tasks.poses import Array, from_rotation_vector, multiply
from hide_tasks.script import Step, steps

DenseMode = Literal["joint_position", "ee_delta"]
CHUNK = 10  # rows of one decision: half a second
ARRIVAL = 5  # rows at most that the arm may take to stand where it was sent
REST = 10  # rows at most that things may take to come to rest


class DenseError(ValueError):
    """The expert has no motion in an episode; the message says where it ends."""


@dataclass(frozen=True)
class Motion:
    """An expert's motion with n rows. All numbers are single precision, as data sets keep them."""

    joints: NDArray[np.float32]  # (n, 7) rad, where they are sent
    deltas: NDArray[np.float32]  # (n, 6) m and rotation vector, the tip's step; see EEDelta
    openings: NDArray[np.float32]  # (n,) what the fingers are told, 0 or 1

    def __len__(self) -> int:
        return len(self.openings)

    def rows(self, mode: DenseMode) -> list[Row]:
        """The rows of dense actions."""
        told = self.joints if mode == "joint_position" else self.deltas
        return [tuple(row) for row in np.column_stack([told, self.openings]).tolist()]

    def chunks(self, mode: DenseMode, size: int = CHUNK) -> list[Action]:
        """The whole motion as actions."""
        rows = self.rows(mode)
        kind = JointPosition if mode == "joint_position" else EEDelta
        return [kind(chunk=tuple(rows[i : i + size])) for i in range(0, len(rows), size)]


Watcher = Callable[[World, Step], None]


def motion(spec: EpisodeSpec, watcher: Watcher | None = None) -> Motion:
    """The expert's motion in an episode; a watcher is called before every row.

    Raises:
        DenseError: a keyframe has no path.
    """
    with World(suite.build(spec)) as world:
        driver = _Driver(world, watcher)
        for step in steps(world.task):
            driver.carry_out(step)
    joints, deltas, openings = (
        np.array(part, np.float32) for part in zip(*driver.rows, strict=True)
    )
    return Motion(joints, deltas, openings)


class _Driver:
    """Carries out keyframes in rows, and keeps these."""

    def __init__(self, world: World, watcher: Watcher | None):
        self.world, self.robot, self.watcher = world, world.robot, watcher
        self.opening = 1.0
        self.rows: list[tuple[Array, Array, float]] = []

    def carry_out(self, step: Step) -> None:
        """Go where a keyframe says, set the fingers, wait until things are at rest."""
        self.step = step
        path = self._path(step.keyframe)
        for joints in path:
            self._row(joints)
        self._arrive(path[-1])
        opening = 1.0 if step.keyframe.opening >= 0.5 else 0.0
        if opening != self.opening:
            self.opening = opening
            self._row(self.robot.joints)
        for _ in range(REST):
            if self.world.scene.still():
                break
            self._row(self.robot.joints)

    def _path(self, keyframe: Keyframe) -> list[Array]:
        """Where the joints are to be after every row."""
        boxes, held = obstacles.of(self.robot)
        for seed in (0, 1):  # the executor tries twice as well
            plan = planner.plan(
                self.robot.joints,
                keyframe.pose,
                boxes,
                opening=self.robot.opening,
                held=held,
                ignore_collisions=keyframe.ignore_collisions,
                seed=seed,
            )
            if isinstance(plan, planner.Plan):
                return [*list(timed(plan.joints))[SUBSTEPS - 1 :: SUBSTEPS], plan.joints[-1]]
        reason = "" if isinstance(plan, planner.Plan) else f": {plan.value}"
        raise DenseError(f"the expert's keyframe of {self.step.stage} has no path{reason}")

    def _arrive(self, goal: Array) -> None:
        for _ in range(ARRIVAL):
            if np.abs(self.robot.joints - goal).max() < SETTLED:
                break
            self._row(goal)

    def _row(self, joints: Array) -> None:
        """One row towards joints: by the step of the tip, as both spaces can tell it."""
        if self.watcher:
            self.watcher(self.world, self.step)
        delta = _single(_delta(self.robot.joints, joints))
        target = _single(_stepped(self.robot.joints, delta, joints))
        self.rows.append((target, delta, self.opening))
        self.world.execute(JointPosition(chunk=((*target.tolist(), self.opening),)))


def _single(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


def _delta(present: Array, goal: Array) -> Array:
    """The step (6,) of the tip from one posture to another."""
    here, there = (matrix_to_pose(tip_pose(q)) for q in (present, goal))
    turn = multiply(there[3:], here[3:] * np.array([-1.0, -1.0, -1.0, 1.0]))
    return np.concatenate([there[:3] - here[:3], _rotation_vector(turn)])


def _rotation_vector(turn: Array) -> Array:
    """The axis (3,) of a quaternion, as long as its angle in rad."""
    sine = float(np.linalg.norm(turn[:3]))
    angle = 2 * math.atan2(sine, abs(float(turn[3])))
    scale = angle / sine if sine > 1e-12 else 2.0
    return turn[:3] * math.copysign(scale, float(turn[3]))


def _stepped(present: Array, delta: Array, otherwise: Array) -> Array:
    """The joints that a step of the tip leads to."""
    tip = matrix_to_pose(tip_pose(present))
    turned = multiply(from_rotation_vector(delta[3:]), tip[3:])
    found = kinematics.track(np.concatenate([tip[:3] + delta[:3], turned]), present)
    return otherwise if found is None else found


class DenseExpert:
    """Plays the expert's motion of its episode in chunks, without looking."""

    def __init__(self, mode: DenseMode, size: int = CHUNK):
        self.mode, self.size = mode, size

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        """Take note of which episode it is."""
        self.spec = spec

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Find out the motion in a world of its own."""
        self.left: Iterator[Action] = iter(motion(self.spec).chunks(self.mode, self.size))

    def act(self, observation: Observation) -> Action:
        """The next chunk."""
        return next(self.left, Stop())
