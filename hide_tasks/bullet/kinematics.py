"""Inverse kinematics of the arm: one posture for one pose.

The arm has seven joints, so a pose of the tip leaves a curve of postures free. `solve` returns the
point of that curve nearest to HOME (in the metric WEIGHTS), a function of the pose alone, so a
picture of the arm does not tell where it came from. All points are found in closed form on a grid
over the last joint (`closed_form`) and carried to the nearest local optimum by Newton's method on
the constraint curve, inside the limits (`descent`).

Metres, radians, world frame; joints are (7,), poses (7,) = x y z qx qy qz qw, matrices (4, 4).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from hide_tasks.bullet.closed_form import SLACK, postures_at
from hide_tasks.bullet.descent import descend, fill_error
from hide_tasks.bullet.frames import FRAMES, TIP, fill_frames
from hide_tasks.bullet.joint_space import LOWER, UPPER, inside
from hide_tasks.bullet.kernels import Array, as_array, compiled
from hide_tasks.bullet.transforms import fill_matrix

HOME = np.array([0.0, 0.1751, 0.0, -0.8731, 0.0, 1.2215, 0.7854])
# Of each joint's squared distance to HOME: the elbow stays in the plane, the wrist does the rest.
WEIGHTS = np.array([2.0, 1.0, 2.0, 1.0, 0.5, 1.0, 0.5])
# Per rad of joint 5, in the ranking alone: of two mirror images, which cost the same, one is best.
WRIST_SIDE = 0.2

_GRID = 48  # values of the last joint at which the curve of postures is sampled
_FINE_GRID = 400  # the same where the first grid finds nothing
_BRANCHES = 16  # more local optima than a pose has


def solutions(pose: ArrayLike) -> list[Array]:
    """All postures (7,) of a pose that are locally nearest to HOME, the best first.

    Empty when the pose is out of reach or is no pose. A function of the pose alone.
    """
    target, found = np.empty((4, 4)), np.empty((_BRANCHES, 7))
    if not fill_matrix(as_array(pose, (7,), "a pose"), target):
        return []
    return list(found[: optima(target, found)])


def solve(pose: ArrayLike) -> Array | None:
    """The posture (7,) of a pose, always the same one; None when it is out of reach."""
    return next(iter(solutions(pose)), None)


def track(pose: ArrayLike, near: ArrayLike) -> Array | None:
    """The posture of a pose that continues `near` (7,) on its branch, None where that ends.

    It satisfies the same optimum as `solve`, so along a path that starts at a solution it is
    the continuous extension of it.
    """
    target, joints = np.empty((4, 4)), as_array(near, (7,), "joints")
    reachable = fill_matrix(as_array(pose, (7,), "a pose"), target)
    return joints if reachable and descend(target, joints, HOME, WEIGHTS) else None


@compiled
def optima(target: Array, found: Array) -> int:
    """Write the distinct local optima of a pose into (m, 7), the best first, and count them.

    At the edge of the reach the curve of postures shrinks to a point and Newton's method may
    not settle; then a much finer grid is searched and its best exact sample stands in.
    """
    count = _search(target, found, np.empty((_GRID, 8, 7)))
    return count if count > 0 else _search(target, found, np.empty((_FINE_GRID, 8, 7)))


@compiled
def _search(target: Array, found: Array, postures: Array) -> int:
    grid = len(postures)
    costs, ranks = np.empty((grid, 8)), np.empty(len(found))
    scan(target, postures, costs)
    q, nominal, weights = np.empty(7), HOME.copy(), WEIGHTS.copy()
    count = cheapest = 0
    for i in range(8 * grid):
        k, row = i // 8, i % 8
        here = costs[k, row]
        cheapest = i if here < costs[cheapest // 8, cheapest % 8] else cheapest
        if (k > 0 and here > costs[k - 1, row]) or (k < grid - 1 and here >= costs[k + 1, row]):
            continue
        for j in range(7):
            q[j] = postures[k, row, j]
        if here < math.inf and descend(target, q, nominal, weights):
            count = _insert(q, found, ranks, count)
    best = postures[cheapest // 8, cheapest % 8]
    if count == 0 and grid == _FINE_GRID and reaches(target, best) and inside(best):
        count = _insert(best, found, ranks, count)
    return count


@compiled
def scan(target: Array, postures: Array, costs: Array) -> None:
    """Sample the curve of postures: fill (grid, 8, 7) and costs (grid, 8), inf where none.

    A sample outside the limits costs so much more that it counts only where no other is near.
    """
    costs[:] = math.inf
    for k in range(len(costs)):
        q7 = LOWER[6] + (UPPER[6] - LOWER[6]) * k / (len(costs) - 1)
        postures_at(target, q7, postures[k])
        for row in range(8):
            one = postures[k, row]
            if math.isnan(one[3]):
                continue
            outside = 0.0
            for j in range(7):
                outside = max(outside, LOWER[j] - one[j], one[j] - UPPER[j])
            if outside <= SLACK:
                costs[k, row] = cost(one) + 1e4 * outside


@compiled
def cost(q: Array) -> float:
    """Weighted squared distance to HOME."""
    total = 0.0
    for k in range(7):
        total += WEIGHTS[k] * (q[k] - HOME[k]) ** 2
    return total


@compiled
def reaches(target: Array, q: Array) -> bool:
    """True when the joints bring the tip to the target within a micrometre and microradian."""
    frames, error = np.empty((FRAMES, 4, 4)), np.empty(6)
    fill_frames(q, frames)
    return not math.isnan(q[0]) and fill_error(frames[TIP], target, error) < 1e-6


@compiled
def _insert(q: Array, found: Array, ranks: Array, count: int) -> int:
    """Put q in its place by rank unless it is known or the list is full; the new count."""
    rank = cost(q) - WRIST_SIDE * q[4]
    for i in range(count):
        apart = 0.0
        for j in range(7):
            apart = max(apart, abs(q[j] - found[i, j]))
        if apart < 1e-4:
            return count
    i = min(count, len(found) - 1)
    if count == len(found) and rank >= ranks[i]:
        return count
    while i > 0 and ranks[i - 1] > rank:
        ranks[i] = ranks[i - 1]
        found[i] = found[i - 1]
        i -= 1
    ranks[i] = rank
    found[i] = q
    return min(count + 1, len(found))
