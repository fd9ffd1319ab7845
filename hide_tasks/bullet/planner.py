"""Paths of the arm: the straight line if it is free, else the joint line, else a search.

Where a path ends depends on the goal and the obstacles alone: on the best solution of the goal
pose that is free. So the picture after a keyframe does not tell what came before it.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hide_tasks.bullet.collision import (
    NO_SPHERES,
    Body,
    Obstacles,
    body,
    checked,
    collides,
    spare,
    tolerance,
)
from hide_tasks.bullet.kinematics import (
    FRAMES,
    LOWER,
    TIP,
    UPPER,
    Array,
    as_array,
    compiled,
    descend,
    fill_frames,
    solutions,
)

JOINT_STEP = 0.03  # rad, the most that a joint moves between two points of a path
LINE_STEP = 0.01  # m, the same for the tip
TURN_STEP = 0.05  # rad, the same for its rotation
_JUMP = 0.2  # rad between points of a straight line: another branch, not a motion
_POSTURE_STEP = 0.05  # rad of change of posture between points of a straight line
_STRIDE = 0.01  # m that any part of the arm may move between two checks near an obstacle
_INTERVALS = 2048  # parts of one edge that may be looked at
_EXTEND = 0.4  # rad, the step of the search
_SAMPLES = 5000  # of the search before it gives up
_SHORTCUTS = 60
# Farthest that a part of the arm can be from the axis of each joint, m.
_REACH = np.array([0.99, 0.99, 0.75, 0.67, 0.28, 0.28, 0.13])


Counts = NDArray[np.int64]
State = NDArray[np.uint64]


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


class _Scene(NamedTuple):
    """What a motion must keep away from."""

    arm: Body
    boxes: Obstacles
    kept: Array  # (s, n) m, the distance that each sphere keeps from each box
    reach: Array  # (7,) m, the longest lever of each joint


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


def _checked(start: Array, goal: Array, scene: _Scene, seed: int) -> Plan | PlanFailure:
    line = straight_line(start, goal)
    if line is not None and path_is_free(line, scene):
        return Plan(dense(line), PathKind.STRAIGHT)
    direct = np.stack([start, goal])
    if path_is_free(direct, scene):
        return Plan(dense(direct), PathKind.JOINT)
    found = np.empty((2 * (_SAMPLES + _SHORTCUTS), 7))
    count = search(start, goal, scene, np.uint64(seed), found)
    return Plan(dense(found[:count]), PathKind.RRT) if count else PlanFailure.NO_PATH


def _prepare(
    start: Array, goals: list[Array], arm: Body, boxes: Obstacles
) -> tuple[_Scene, Array | None]:
    """The scene of a motion and its goal: the best posture whose links are free, if any is.

    All postures of a pose put the gripper in one place, so that what it touches at the start
    is tolerated for each of them alike, and the choice does not depend on the start.
    """
    held = arm.spheres[arm.starts[-2] :]
    extent = float((np.sqrt((held[:, :3] ** 2).sum(1)) + held[:, 3]).max(initial=0.0))
    scene = _Scene(arm, boxes, tolerance(start, arm, boxes), _REACH + extent)
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


def straight_line(start: ArrayLike, goal: ArrayLike) -> Array | None:
    """Joints (n, 7) from start to goal while the tip moves and turns straight, or None.

    The posture goes from the one to the other along the way. None where it would have to jump.
    """
    first, last = as_array(start, (7,), "start"), as_array(goal, (7,), "goal")
    path = np.empty((_line_points(first, last), 7))
    return path if follow_line(first, last, path) else None


def dense(path: Array) -> Array:
    """The path (n, 7) with points added until no step is longer than JOINT_STEP or LINE_STEP."""
    counts = np.array([_steps(a, b) for a, b in pairwise(path)])
    out = np.empty((int(counts.sum()) + 1, 7))
    fill_dense(path, counts, out)
    return out


def compile_kernels() -> None:
    """Compile everything a plan needs, or load it from the cache; call before forking workers."""
    box = Obstacles(np.array([[0.2, 0.0, 0.9]]), np.eye(3)[None], np.full((1, 3), 0.1))
    start = solutions([0.2, -0.3, 0.9, 1.0, 0.0, 0.0, 0.0])[0]
    plan(start, [0.2, 0.3, 0.9, 1.0, 0.0, 0.0, 0.0], box, opening=1.0)


# --- straight lines ---


@compiled
def _tip(q: Array) -> Array:
    frames: Array = np.empty((FRAMES, 4, 4))
    fill_frames(q, frames)
    tip: Array = frames[TIP]
    return tip


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


@compiled
def _line_points(start: Array, goal: Array) -> int:
    """How many points a straight line between two postures needs."""
    a, b = _tip(start), _tip(goal)
    length = math.sqrt(
        (b[0, 3] - a[0, 3]) ** 2 + (b[1, 3] - a[1, 3]) ** 2 + (b[2, 3] - a[2, 3]) ** 2
    )
    turn = _rotation_between(a, b)
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    change = _change(start, goal)
    return 1 + math.ceil(max(length / LINE_STEP, angle / TURN_STEP, change / _POSTURE_STEP, 1.0))


@compiled
def _change(a: Array, b: Array) -> float:
    """How far the joint moves that moves most, rad."""
    most = 0.0
    for k in range(7):
        most = max(most, abs(b[k] - a[k]))
    return most


@compiled
def follow_line(start: Array, goal: Array, path: Array) -> bool:
    """Write postures of equally spaced points of the straight line; False where one would jump.

    Each is the posture of its point that is nearest to the joint line from start to goal.
    """
    a, b = _tip(start), _tip(goal)
    turn = _rotation_between(a, b)
    target, weights = np.empty((4, 4)), np.ones(7)
    last = len(path) - 1
    _copy(start, path[0])
    _copy(goal, path[last])
    q, nominal = start.copy(), np.empty(7)
    for i in range(1, last):
        part = i / last
        _between(a, b, turn, part, target)
        for k in range(7):
            nominal[k] = start[k] + part * (goal[k] - start[k])
        if not descend(target, q, nominal, weights):
            return False
        _copy(q, path[i])
        if _change(path[i - 1], path[i]) > _JUMP:
            return False
    return _change(path[last - 1], path[last]) <= _JUMP


# --- free paths ---


@compiled
def edge_is_free(a: Array, b: Array, scene: _Scene) -> bool:
    """True when all postures between a (free itself) and b keep their distances.

    Halves what is not known to be free: around a posture with some room to spare it is free as
    far as no part of the arm moves further than that (Schwarzer, Saha and Latombe 2005).
    """
    speed = 0.0
    for k in range(7):
        speed += abs(b[k] - a[k]) * scene.reach[k]
    if spare(b, scene.arm, scene.boxes, scene.kept, 0.0) < 0.0:
        return False
    q, parts = np.empty(7), np.empty((_INTERVALS, 2))
    parts[0, 0], parts[0, 1] = 0.0, 1.0
    done, count = 0, 1
    while done < count:
        first, last = parts[done]
        done += 1
        width = (last - first) * speed
        if width <= _STRIDE:
            continue
        middle = 0.5 * (first + last)
        for k in range(7):
            q[k] = a[k] + middle * (b[k] - a[k])
        room = spare(q, scene.arm, scene.boxes, scene.kept, 0.5 * width)
        if room < 0.0 or count + 2 > _INTERVALS:
            return False
        if 2.0 * room < width:
            parts[count, 0], parts[count, 1] = first, middle - room / speed
            parts[count + 1, 0], parts[count + 1, 1] = middle + room / speed, last
            count += 2
    return True


@compiled
def path_is_free(path: Array, scene: _Scene) -> bool:
    """True when all edges of a path are free; that its first point is free is taken as given."""
    free = True
    for i in range(len(path) - 1):
        free = free and edge_is_free(path[i], path[i + 1], scene)
    return free


# --- the search ---


@compiled
def _draw(state: State) -> float:
    """The next number in [0, 1) of a splitmix64 generator (Steele, Lea and Flood 2014)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53


@compiled
def _nearest(tree: Array, count: int, q: Array) -> int:
    best, least = 0, math.inf
    for i in range(count):
        square = 0.0
        for k in range(7):
            square += (tree[i, k] - q[k]) ** 2
        if square < least:
            best, least = i, square
    return best


@compiled
def _step_towards(a: Array, b: Array, out: Array) -> bool:
    """Write the point at most _EXTEND from a towards b; True when it is b."""
    square = 0.0
    for k in range(7):
        square += (b[k] - a[k]) ** 2
    part = _EXTEND / max(math.sqrt(square), 1e-12)
    for k in range(7):
        out[k] = b[k] if part >= 1.0 else a[k] + part * (b[k] - a[k])
    return part >= 1.0


@compiled
def search(start: Array, goal: Array, scene: _Scene, seed: np.uint64, path: Array) -> int:
    """RRT-Connect (Kuffner and LaValle 2000): write the corners of a path, count them; 0: none."""
    size = len(path) // 2 - _SHORTCUTS
    state = np.array([seed], dtype=np.uint64)
    trees, parents = np.empty((2, size, 7)), np.empty((2, size), dtype=np.int64)
    counts = np.ones(2, dtype=np.int64)
    _copy(start, trees[0, 0])
    _copy(goal, trees[1, 0])
    parents[0, 0] = parents[1, 0] = -1
    target, new = np.empty(7), np.empty(7)
    for turn in range(_SAMPLES):
        one, other = turn % 2, 1 - turn % 2
        for k in range(7):
            target[k] = LOWER[k] + (UPPER[k] - LOWER[k]) * _draw(state)
        near = _nearest(trees[one], counts[one], target)
        _step_towards(trees[one, near], target, new)
        if not edge_is_free(trees[one, near], new, scene):
            continue
        _grow(trees[one], parents[one], counts, one, near, new)
        met = _connect(trees[other], parents[other], counts, other, new, scene)
        if met >= 0:
            ends = (counts[one] - 1, met) if one == 0 else (met, counts[one] - 1)
            length = _join(trees, parents, ends[0], ends[1], path)
            return _shorten(path, length, scene, state)
        if counts[0] >= size - 1 or counts[1] >= size - 1:
            return 0
    return 0


@compiled
def _grow(tree: Array, parent: Counts, counts: Counts, which: int, near: int, q: Array) -> None:
    _copy(q, tree[counts[which]])
    parent[counts[which]] = near
    counts[which] += 1


@compiled
def _connect(
    tree: Array, parent: Counts, counts: Counts, which: int, goal: Array, scene: _Scene
) -> int:
    """Grow a tree towards the goal as far as it goes; the node that is the goal, or -1."""
    near, new = _nearest(tree, counts[which], goal), np.empty(7)
    while counts[which] < len(tree):
        arrived = _step_towards(tree[near], goal, new)
        if not edge_is_free(tree[near], new, scene):
            return -1
        _grow(tree, parent, counts, which, near, new)
        near = int(counts[which]) - 1
        if arrived:
            return near
    return -1


@compiled
def _join(trees: Array, parents: Counts, first: int, second: int, path: Array) -> int:
    """Write the path from the root of the first tree over the meeting point to the second's."""
    length, node = 0, first
    while node >= 0:
        length += 1
        node = parents[0, node]
    node = first
    for i in range(length):
        _copy(trees[0, node], path[length - 1 - i])
        node = parents[0, node]
    node = parents[1, second]
    while node >= 0:
        _copy(trees[1, node], path[length])
        length += 1
        node = parents[1, node]
    return length


@compiled
def _shorten(path: Array, length: int, scene: _Scene, state: State) -> int:
    """Cut corners between random points of the path; its new number of points."""
    a, b, after = np.empty(7), np.empty(7), np.empty(path.shape)
    for _ in range(_SHORTCUTS):
        x, y = _draw(state) * (length - 1), _draw(state) * (length - 1)
        x, y = min(x, y), max(x, y)
        i, j = int(x), int(y)
        _along(path, x, a)
        _along(path, y, b)
        if i == j or not edge_is_free(a, b, scene):
            continue
        for n in range(j + 1, length):
            _copy(path[n], after[n])
        _copy(a, path[i + 1])
        _copy(b, path[i + 2])
        for n in range(j + 1, length):
            _copy(after[n], path[n + i + 2 - j])
        length += i + 2 - j
    return length


@compiled
def _along(path: Array, where: float, out: Array) -> None:
    """Write the point between two corners of a path."""
    i = int(where)
    for k in range(7):
        out[k] = path[i, k] + (where - i) * (path[i + 1, k] - path[i, k])


@compiled
def _copy(source: Array, out: Array) -> None:
    for k in range(7):
        out[k] = source[k]


# --- dense paths ---


@compiled
def _steps(a: Array, b: Array) -> int:
    """How many equal steps an edge needs: as many as its fastest part."""
    count = max(1, math.ceil(_change(a, b) / JOINT_STEP - 1e-9))
    before, longest, q = _tip(a), 0.0, np.empty(7)
    for i in range(count):
        for k in range(7):
            q[k] = a[k] + (b[k] - a[k]) * ((i + 1) / count)
        after = _tip(q)
        square = 0.0
        for k in range(3):
            square += (after[k, 3] - before[k, 3]) ** 2
        before, longest = after, max(longest, math.sqrt(square))
    return max(count, math.ceil(count * longest / LINE_STEP - 1e-3))


@compiled
def fill_dense(path: Array, counts: Array, out: Array) -> None:
    """Write the path with counts[i] equal steps on edge i; its corners stay exact."""
    n = 0
    for i in range(len(counts)):
        for j in range(counts[i]):
            for k in range(7):
                out[n, k] = path[i, k] + j / counts[i] * (path[i + 1, k] - path[i, k])
            n += 1
    _copy(path[len(path) - 1], out[n])
