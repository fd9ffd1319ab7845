"""Straight lines of the tip, as joints."""

import math

import numpy as np
from numpy.typing import ArrayLike

from hide_tasks.bullet.dense_paths import LINE_STEP
from hide_tasks.bullet.descent import descend
from hide_tasks.bullet.frames import tip_frame
from hide_tasks.bullet.joint_space import copy, largest_change
from hide_tasks.bullet.kernels import Array, as_array, compiled

TURN_STEP = 0.05  # rad that the tip turns between two points of a straight line
_JUMP = 0.2  # rad between points of a straight line: another branch, not a motion
_POSTURE_STEP = 0.05  # rad of change of posture between points of a straight line


def straight_line(start: ArrayLike, goal: ArrayLike) -> Array | None:
    """Joints (n, 7) from start to goal while the tip moves and turns straight, or None.

    The posture goes from the one to the other along the way. None where it would have to jump.
    """
    first, last = as_array(start, (7,), "start"), as_array(goal, (7,), "goal")
    path = np.empty((_line_points(first, last), 7))
    return path if follow_line(first, last, path) else None


@compiled
def _line_points(start: Array, goal: Array) -> int:
    """How many points a straight line between two postures needs."""
    a, b = tip_frame(start), tip_frame(goal)
    length = math.sqrt(
        (b[0, 3] - a[0, 3]) ** 2 + (b[1, 3] - a[1, 3]) ** 2 + (b[2, 3] - a[2, 3]) ** 2
    )
    turn = _rotation_between(a, b)
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    change = largest_change(start, goal)
    return 1 + math.ceil(max(length / LINE_STEP, angle / TURN_STEP, change / _POSTURE_STEP, 1.0))


@compiled
def follow_line(start: Array, goal: Array, path: Array) -> bool:
    """Write postures of equally spaced points of the straight line; False where one would jump.

    Each is the posture of its point that is nearest to the joint line from start to goal.
    """
    a, b = tip_frame(start), tip_frame(goal)
    turn = _rotation_between(a, b)
    target, weights = np.empty((4, 4)), np.ones(7)
    last = len(path) - 1
    copy(start, path[0])
    copy(goal, path[last])
    q, nominal = start.copy(), np.empty(7)
    for i in range(1, last):
        part = i / last
        _between(a, b, turn, part, target)
        for k in range(7):
            nominal[k] = start[k] + part * (goal[k] - start[k])
        if not descend(target, q, nominal, weights):
            return False
        copy(q, path[i])
        if largest_change(path[i - 1], path[i]) > _JUMP:
            return False
    return largest_change(path[last - 1], path[last]) <= _JUMP


@compiled
def _rotation_between(a: Array, b: Array) -> Array:
    """The rotation vector (3,), in a's frame, that turns transform a into b."""
    turn = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                turn[i, j] += a[k, i] * b[k, j]
    w = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    angle = math.atan2(sine, turn[0, 0] + turn[1, 1] + turn[2, 2] - 1.0)
    if sine > 1e-7:
        for r in range(3):
            w[r] *= angle / sine
        return w
    # No turn, or half a turn about the axis with the largest diagonal element.
    i = 0
    for k in range(1, 3):
        i = k if turn[k, k] > turn[i, i] else i
    for r in range(3):
        w[r] = turn[r, i] + (1.0 if r == i else 0.0)
    size = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    for r in range(3):
        w[r] *= angle / max(size, 1e-12)
    return w


@compiled
def _between(a: Array, b: Array, turn: Array, part: float, out: Array) -> None:
    """Write the transform a part of the way from a to b, whose rotation vector is turn."""
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    c, s = math.cos(part * angle), math.sin(part * angle)
    spin, u = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        u[i] = turn[i] / max(angle, 1e-12)
    for i in range(3):
        for j in range(3):
            spin[i, j] = (1.0 - c) * u[i] * u[j] + (c if i == j else 0.0)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        spin[k, j] += s * u[i]
        spin[j, k] -= s * u[i]
    out[:] = 0.0
    out[3, 3] = 1.0
    for i in range(3):
        out[i, 3] = (1.0 - part) * a[i, 3] + part * b[i, 3]
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * spin[k, j]
