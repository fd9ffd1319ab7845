"""Carries out actions: plans, follows, sets the fingers, and tells what became of it.

The executor alone chooses the arm's configuration, by a fixed rule from the pose and the present
joints, so a policy that repeats an expert's poses gets the expert's result.
"""

from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np

from hide_tasks.assets.asset import Asset
from hide_tasks.bullet import kinematics, obstacles, planner
from hide_tasks.bullet.frames import tip_pose
from hide_tasks.bullet.robot import Robot
from hide_tasks.bullet.scene import HZ
from hide_tasks.bullet.transforms import matrix_to_pose
from hide_tasks.contract import (
    CONTROL_HZ,
    Action,
    EEDelta,
    JointPosition,
    Keyframe,
    MotionOutcome,
)
from hide_tasks.poses import Array, from_rotation_vector, multiply

SUBSTEPS = HZ // CONTROL_HZ
JOINT_STEP = 2.6 / CONTROL_HZ  # rad that a joint may be told to move in one dense row (Franka)
STEP_LIMITS = (-JOINT_STEP, JOINT_STEP)


class Motion(NamedTuple):
    """What became of an action."""

    outcome: MotionOutcome
    path: str = ""  # straight, joint, rrt or dense
    retried: bool = False


class Executor:
    """Acts for a policy; also what a task may ask of the robot."""

    def __init__(self, robot: Robot):
        self.robot = robot
        self.planning_seconds = 0.0

    # --- acting ---

    def execute(self, action: Action) -> Motion:
        """Carry out an action; a motion that cannot be planned leaves everything as it is."""
        if isinstance(action, Keyframe):
            return self._keyframe(action)
        if isinstance(action, JointPosition | EEDelta):
            return self._dense(action)
        return Motion(MotionOutcome.NONE)

    def _keyframe(self, action: Keyframe) -> Motion:
        plan, retried = self._plan(action), False
        if isinstance(plan, planner.PlanFailure):
            plan, retried = self._plan(action, retry=True), True
        if isinstance(plan, planner.PlanFailure):
            return Motion(MotionOutcome(plan.value), retried=retried)
        arrived = self.robot.follow(plan.joints)
        self.robot.set_fingers(action.opening >= 0.5)
        outcome = MotionOutcome.ARRIVED if arrived else MotionOutcome.BLOCKED
        return Motion(outcome, str(plan.kind), retried)

    def _plan(self, action: Keyframe, *, retry: bool = False) -> planner.Plan | planner.PlanFailure:
        start = perf_counter()
        boxes, held = obstacles.of(self.robot)
        try:
            return planner.plan(
                self.robot.joints,
                action.pose,
                boxes,
                opening=self.robot.opening,
                held=held,
                ignore_collisions=action.ignore_collisions,
                seed=int(retry),
            )
        finally:
            self.planning_seconds += perf_counter() - start

    def _dense(self, action: JointPosition | EEDelta) -> Motion:
        reached = 0
        for row in action.chunk:
            present = self.robot.joints
            target = self._target(action.kind, np.array(row))
            reached += target is not None
            step = np.clip((present if target is None else target) - present, *STEP_LIMITS)
            self.robot.servo(present + step, SUBSTEPS)
            self.robot.set_fingers(row[-1] >= 0.5)
        outcome = MotionOutcome.ARRIVED if reached else MotionOutcome.OUT_OF_REACH
        return Motion(outcome, "dense")

    def _target(self, kind: str, row: Array) -> Array | None:
        if kind == "joint_position":
            return row[:7]
        present = self.robot.joints
        tip = matrix_to_pose(tip_pose(present))
        turned = multiply(from_rotation_vector(row[3:6]), tip[3:])
        return kinematics.track(np.concatenate([tip[:3] + row[:3], turned]), present)

    # --- what tasks may ask ---

    @property
    def tip_height(self) -> float:
        """The tip's height above the table, m."""
        return self.robot.tip_height

    def holds(self, asset: Asset) -> bool:
        """True while the gripper holds the asset."""
        return self.robot.holds(asset)

    def first_feasible(self, chains: Iterator[list[Array]]) -> int:
        """The index of the first chain of tip poses that straight lines join; -1 if none.

        Obstacles are not asked: this chooses how to approach, the planner how to get there.
        """
        for index, chain in enumerate(chains):
            if planner.joined(chain):
                return index
        return -1
