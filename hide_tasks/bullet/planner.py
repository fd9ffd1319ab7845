"""Paths of the arm: the straight line if it is free, else the joint line, else a search.

Where a path ends depends on the goal and the obstacles alone: on the best solution of the goal
pose that is free. So the picture after a keyframe does not tell what came before it.
"""

from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hide_tasks.bullet.collision import (
    NO_SPHERES,
    Body,
    Obstacles,
    body,
    checked,
    collides,
    tolerance,
)
from hide_tasks.bullet.dense_paths import dense
from hide_tasks.bullet.free_paths import PlanningScene, path_is_free
from hide_tasks.bullet.kernels import Array, as_array
from hide_tasks.bullet.kinematics import solutions
from hide_tasks.bullet.rrt_connect import SAMPLES, SHORTCUTS, search
from hide_tasks.bullet.straight_lines import straight_line

# Farthest that a part of the arm can be from the axis of each joint, m.
_REACH = np.array([0.99, 0.99, 0.75, 0.67, 0.28, 0.28, 0.13])


class PathKind(StrEnum):
    """How a path was found."""

    STRAIGHT = "straight"
    JOINT = "joint"
    RRT = "rrt"


class PlanFailure(StrEnum):
    """Why there is no path."""

    OUT_OF_REACH = "out_of_reach"
    GOAL_IN_COLLISION = "goal_in_collision"
    NO_PATH = "no_path"


class Plan(NamedTuple):
    """A path from the present joints to the goal's posture."""

    joints: Array  # (n, 7) rad, steps of at most 0.03 rad and 1 cm
    kind: PathKind


def plan(
    start: ArrayLike,
    goal_pose: ArrayLike,
    world: Obstacles,
    *,
    opening: float,
    held: ArrayLike = NO_SPHERES,
    ignore_collisions: bool = False,
    seed: int = 0,
) -> Plan | PlanFailure:
    """A path from the joints `start` (7,) to a pose of the tip, or why there is none.

    Everything keeps 4 mm from the boxes, except what touches them at the start. A function of
    its arguments: the search draws from `seed` and ends by its number of samples.

    Raises:
        ValueError: the start is not finite, or an array has a wrong shape.
    """
    joints = as_array(start, (7,), "start")
    if not np.isfinite(joints).all():
        raise ValueError(f"start must be finite joint angles in rad, not {joints}")
    goals = solutions(goal_pose)
    if not goals:
        return PlanFailure.OUT_OF_REACH
    if ignore_collisions:
        return _unchecked(joints, goals[0])
    scene, goal = _prepare(joints, goals, body(opening, held), checked(world))
    return PlanFailure.GOAL_IN_COLLISION if goal is None else _checked(joints, goal, scene, seed)


def _unchecked(start: Array, goal: Array) -> Plan:
    line = straight_line(start, goal)
    if line is not None:
        return Plan(dense(line), PathKind.STRAIGHT)
    return Plan(dense(np.stack([start, goal])), PathKind.JOINT)


def _checked(start: Array, goal: Array, scene: PlanningScene, seed: int) -> Plan | PlanFailure:
    line = straight_line(start, goal)
    if line is not None and path_is_free(line, scene):
        return Plan(dense(line), PathKind.STRAIGHT)
    direct = np.stack([start, goal])
    if path_is_free(direct, scene):
        return Plan(dense(direct), PathKind.JOINT)
    found = np.empty((2 * (SAMPLES + SHORTCUTS), 7))
    count = search(start, goal, scene, np.uint64(seed), found)
    return Plan(dense(found[:count]), PathKind.RRT) if count else PlanFailure.NO_PATH


def _prepare(
    start: Array, goals: list[Array], arm: Body, boxes: Obstacles
) -> tuple[PlanningScene, Array | None]:
    """The scene of a motion and its goal: the best posture whose links are free, if any is.

    All postures of a pose put the gripper in one place, so that what it touches at the start
    is tolerated for each of them alike, and the choice does not depend on the start.
    """
    held = arm.spheres[arm.starts[-2] :]
    extent = float((np.sqrt((held[:, :3] ** 2).sum(1)) + held[:, 3]).max(initial=0.0))
    scene = PlanningScene(arm, boxes, tolerance(start, arm, boxes), _REACH + extent)
    careful = tolerance(start, arm, boxes, gripper_only=True)
    for kept in (careful, scene.kept):
        for goal in goals:
            if not collides(goal, arm, boxes, kept):
                return scene, goal
    return scene, None


def joined(chain: Sequence[ArrayLike]) -> bool:
    """True when straight lines lead through all poses (7,), each in its best posture.

    Obstacles are not asked. False when a pose is out of reach.
    """
    best = [solutions(pose)[:1] for pose in chain]
    if not all(best):
        return False
    postures = [one[0] for one in best]
    return all(straight_line(a, b) is not None for a, b in pairwise(postures))


def compile_kernels() -> None:
    """Compile everything a plan needs, or load it from the cache; call before forking workers."""
    box = Obstacles(np.array([[0.2, 0.0, 0.9]]), np.eye(3)[None], np.full((1, 3), 0.1))
    start = solutions([0.2, -0.3, 0.9, 1.0, 0.0, 0.0, 0.0])[0]
    plan(start, [0.2, 0.3, 0.9, 1.0, 0.0, 0.0, 0.0], box, opening=1.0)
