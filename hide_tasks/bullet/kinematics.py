"""Forward and inverse kinematics of the arm: one posture for one pose.

The arm has seven joints, so a pose of the tip leaves a curve of postures free. `solve` returns the
point of that curve nearest to HOME (in the metric WEIGHTS), a function of the pose alone, so a
picture of the arm does not tell where it came from. All points are found in closed form on a grid
over the last joint (He and Liu, "Analytical inverse kinematics for Franka Emika Panda", 2021, solve
the same geometry) and carried to the nearest local optimum by Newton's method on the constraint
curve, inside the limits.

Metres, radians, world frame; joints are (7,), poses (7,) = x y z qx qy qz qw, matrices (4, 4).
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Kernel = TypeVar("Kernel", bound=Callable[..., Any])

BASE = np.array([-0.26, -0.01, 0.764])  # m, the robot's base in the world (RLBench)
HOME = np.array([0.0, 0.1751, 0.0, -0.8731, 0.0, 1.2215, 0.7854])
MARGIN = 0.02  # rad kept from Franka's soft limits
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]) + MARGIN
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]) - MARGIN
# Of each joint's squared distance to HOME: the elbow stays in the plane, the wrist does the rest.
WEIGHTS = np.array([2.0, 1.0, 2.0, 1.0, 0.5, 1.0, 0.5])
# Per rad of joint 5, in the ranking alone: of two mirror images, which cost the same, one is best.
WRIST_SIDE = 0.2

# The chain of panda.urdf: quarter turns about x and the offset of each joint in its parent (m).
_TURNS = np.array([0, -1, 1, 1, -1, 1, 1])
_OFFSETS = np.array(
    [
        [0.0, 0.0, 0.333],
        [0.0, 0.0, 0.0],
        [0.0, -0.316, 0.0],
        [0.0825, 0.0, 0.0],
        [-0.0825, 0.384, 0.0],
        [0.0, 0.0, 0.0],
        [0.088, 0.0, 0.0],
    ]
)
_FLANGE = 0.107  # m from joint 7 to the hand, which is turned by -45 degrees
_TIP = 0.105  # m from the hand to the tip
HAND, TIP, FRAMES = 8, 9, 10  # indices into `link_frames`; 0 is the base, 1 to 7 the links

_GRID = 48  # values of the last joint at which the curve of postures is sampled
_FINE_GRID = 400  # the same where the first grid finds nothing
_BRANCHES = 16  # more local optima than a pose has
_SLACK = 0.1  # a sample this far outside the limits or the reach may still lead inside
_STEP = 0.4  # rad, the longest step of one iteration
_OFF = 0.02  # m or rad off the curve after a step: the next is half as long
_ITERATIONS = 40
_PATIENCE = 5  # iterations without a posture inside the limits in sight
_CONVERGED = 1e-9  # rad, the last step of an iteration that counts as converged


def compiled(function: Kernel) -> Kernel:
    """The function as machine code, cached on disk; strict floating point, so repeatable."""
    return cast(Kernel, numba.njit(cache=True)(function))


@compiled
def fill_frames(q: Array, frames: Array) -> None:
    """Write the frames of base, links 1 to 7, hand and tip into (10, 4, 4)."""
    frames[:] = 0.0
    for i in range(FRAMES):
        frames[i, 3, 3] = 1.0
    for r in range(3):
        frames[0, r, r] = 1.0
        frames[0, r, 3] = BASE[r]
    for i in range(7):
        c, s = math.cos(q[i]), math.sin(q[i])
        parent, child = frames[i], frames[i + 1]
        for r in range(3):
            x, y, z = parent[r, 0], parent[r, 1], parent[r, 2]
            child[r, 3] = (
                parent[r, 3] + (x * _OFFSETS[i, 0] + y * _OFFSETS[i, 1]) + z * _OFFSETS[i, 2]
            )
            if _TURNS[i] == 1:
                y, z = z, -y
            elif _TURNS[i] == -1:
                y, z = -z, y
            child[r, 0] = c * x + s * y
            child[r, 1] = c * y - s * x
            child[r, 2] = z
    h = math.sqrt(0.5)
    for r in range(3):
        x, y, z = frames[7, r, 0], frames[7, r, 1], frames[7, r, 2]
        frames[8, r, 0] = h * (x - y)
        frames[8, r, 1] = h * (x + y)
        frames[8, r, 2] = z
        frames[8, r, 3] = frames[7, r, 3] + _FLANGE * z
        for k in range(3):
            frames[9, r, k] = frames[8, r, k]
        frames[9, r, 3] = frames[8, r, 3] + _TIP * z


@compiled
def fill_jacobian(frames: Array, jac: Array) -> None:
    """Write the velocity of the tip per joint into (6, 7): linear above angular, world frame."""
    for i in range(7):
        z0, z1, z2 = frames[i + 1, 0, 2], frames[i + 1, 1, 2], frames[i + 1, 2, 2]
        d0 = frames[TIP, 0, 3] - frames[i + 1, 0, 3]
        d1 = frames[TIP, 1, 3] - frames[i + 1, 1, 3]
        d2 = frames[TIP, 2, 3] - frames[i + 1, 2, 3]
        jac[0, i] = z1 * d2 - z2 * d1
        jac[1, i] = z2 * d0 - z0 * d2
        jac[2, i] = z0 * d1 - z1 * d0
        jac[3, i] = z0
        jac[4, i] = z1
        jac[5, i] = z2


@compiled
def _fill_error(tip: Array, target: Array, error: Array) -> float:
    """Write the twist (6,) that carries the tip into the target; its largest part (m or rad)."""
    trace, sine, most = 0.0, 0.0, 0.0
    for r in range(3):
        a, b = (r + 1) % 3, (r + 2) % 3
        error[r], error[3 + r] = target[r, 3] - tip[r, 3], 0.0
        for k in range(3):
            error[3 + r] += 0.5 * (tip[a, k] * target[b, k] - tip[b, k] * target[a, k])
            trace += tip[r, k] * target[r, k]
        sine += error[3 + r] ** 2
    sine = math.sqrt(sine)
    scale = math.atan2(sine, 0.5 * (trace - 1.0)) / sine if sine > 1e-9 else 1.0
    for r in range(3):
        error[3 + r] *= scale
        most = max(most, abs(error[r]), abs(error[3 + r]))
    return most


@compiled
def _factor(jac: Array, low: Array) -> None:
    """Write the Cholesky factor of J J^T, very lightly damped, into (6, 6)."""
    for r in range(6):
        for c in range(r + 1):
            total = 1e-10 if r == c else 0.0
            for k in range(7):
                total += jac[r, k] * jac[c, k]
            for k in range(c):
                total -= low[r, k] * low[c, k]
            low[r, c] = math.sqrt(max(total, 1e-12)) if r == c else total / low[c, c]


@compiled
def _divide(low: Array, b: Array) -> None:
    """Solve L L^T x = b in place."""
    for r in range(6):
        for k in range(r):
            b[r] -= low[r, k] * b[k]
        b[r] /= low[r, r]
    for r in range(5, -1, -1):
        for k in range(r + 1, 6):
            b[r] -= low[k, r] * b[k]
        b[r] /= low[r, r]


@compiled
def _project(jac: Array, low: Array, v: Array, out: Array, b: Array) -> None:
    """Write the part of v (7,) that does not move the tip into out; b keeps the multipliers."""
    for r in range(6):
        b[r] = 0.0
        for k in range(7):
            b[r] += jac[r, k] * v[k]
    _divide(low, b)
    for k in range(7):
        out[k] = v[k]
        for r in range(6):
            out[k] -= jac[r, k] * b[r]


@compiled
def _aim(jac: Array, low: Array, seed: Array, out: Array, b: Array) -> None:
    """Make seed the joint that moves most while the tip stands still."""
    best, most = 0, -1.0
    for k in range(7):
        seed[:] = 0.0
        seed[k] = 1.0
        _project(jac, low, seed, out, b)
        if out[k] > most:
            best, most = k, out[k]
    seed[:] = 0.0
    seed[best] = 1.0


@compiled
def _bend(frames: Array, jac: Array, n: Array, b: Array) -> float:
    """b . (dJ/dt n) while the joints move at n: how the curve of postures bends along b."""
    w0 = w1 = w2 = total = 0.0
    for k in range(7):
        z0, z1, z2 = (
            frames[k + 1, 0, 2] * n[k],
            frames[k + 1, 1, 2] * n[k],
            frames[k + 1, 2, 2] * n[k],
        )
        v0, v1, v2 = jac[0, k] * n[k], jac[1, k] * n[k], jac[2, k] * n[k]
        total += b[3] * (w1 * z2 - w2 * z1) + b[4] * (w2 * z0 - w0 * z2)
        total += b[5] * (w0 * z1 - w1 * z0)
        u0, u1, u2 = 2.0 * w0 + z0, 2.0 * w1 + z1, 2.0 * w2 + z2
        total += b[0] * (u1 * v2 - u2 * v1) + b[1] * (u2 * v0 - u0 * v2)
        total += b[2] * (u0 * v1 - u1 * v0)
        w0, w1, w2 = w0 + z0, w1 + z1, w2 + z2
    return total


@compiled
def _null_direction(jac: Array, low: Array, n: Array, b: Array, aim: bool) -> None:
    """Turn n (7,) into the unit vector along the curve, on the side where it points already."""
    if aim:
        _aim(jac, low, n, np.empty(7), b)
    along = np.empty(7)
    _project(jac, low, n, along, b)
    size = 0.0
    for k in range(7):
        size += along[k] * along[k]
    size = math.sqrt(max(size, 1e-20))
    for k in range(7):
        n[k] = along[k] / size


@compiled
def _newton(
    frames: Array, jac: Array, low: Array, n: Array, dq: Array, pull: Array, weights: Array
) -> float:
    """How far along n the cost is least, after the step dq; pull is the cost's gradient."""
    b, slope, flat = np.empty(6), 0.0, 0.0
    for r in range(6):
        b[r] = 0.0
        for k in range(7):
            b[r] += jac[r, k] * pull[k]
    _divide(low, b)
    for k in range(7):
        slope += n[k] * (pull[k] + weights[k] * dq[k])
        flat += n[k] * weights[k] * n[k]
    curve = flat - _bend(frames, jac, n, b)
    return -slope / (curve if curve > 0.01 * flat else flat)


@compiled
def _room(q: Array, dq: Array, n: Array) -> tuple[float, float]:
    """Between which steps along n the joints stay within their limits; reversed when at none."""
    first, last = -10.0, 10.0
    for k in range(7):
        if abs(n[k]) > 1e-9:
            one, two = (LOWER[k] - q[k] - dq[k]) / n[k], (UPPER[k] - q[k] - dq[k]) / n[k]
            first, last = max(first, min(one, two)), min(last, max(one, two))
    return first, last


@compiled
def descend(target: Array, q: Array, nominal: Array, weights: Array) -> bool:
    """Carry q to the nearest posture of the target (4, 4) that is locally closest to nominal.

    Newton's method on the curve of postures: the step along the curve uses its bend, the step
    across it the Jacobian; joints stop at their limits. False when it does not converge.
    """
    frames, jac, low = np.empty((FRAMES, 4, 4)), np.empty((6, 7)), np.empty((6, 6))
    error, b = np.empty(6), np.empty(6)
    dq, n, pull = np.empty(7), np.empty(7), np.empty(7)
    stuck, trust = 0, _STEP
    for step in range(_ITERATIONS):
        fill_frames(q, frames)
        fill_jacobian(frames, jac)
        off = _fill_error(frames[TIP], target, error)
        trust = 0.5 * trust if off > _OFF and step > 0 else min(2.0 * trust, _STEP)
        _factor(jac, low)
        _divide(low, error)
        _null_direction(jac, low, n, b, step == 0)
        for k in range(7):
            dq[k] = 0.0
            for r in range(6):
                dq[k] += jac[r, k] * error[r]
            pull[k] = weights[k] * (q[k] - nominal[k])
        first, last = _room(q, dq, n)
        stuck += first > last
        along = min(max(_newton(frames, jac, low, n, dq, pull, weights), first), last)
        along, longest = min(max(along, -trust), trust), 0.0
        for k in range(7):
            dq[k] += along * n[k]
            longest = max(longest, abs(dq[k]))
        if not longest < 1e3 or stuck > _PATIENCE:
            return False
        for k in range(7):
            q[k] += dq[k] * min(1.0, _STEP / max(longest, 1e-12))
        if longest < _CONVERGED:
            return _inside(q)
    return False


@compiled
def _inside(q: Array) -> bool:
    for k in range(7):
        if not LOWER[k] - 1e-9 <= q[k] <= UPPER[k] + 1e-9:
            return False
        q[k] = min(max(q[k], LOWER[k]), UPPER[k])
    return True


@compiled
def cost(q: Array) -> float:
    """Weighted squared distance to HOME."""
    total = 0.0
    for k in range(7):
        total += WEIGHTS[k] * (q[k] - HOME[k]) ** 2
    return total


@compiled
def _unwind(x: Array, y: Array, z: Array, angle: float, turn: float) -> None:
    """Undo Rz(angle), then a quarter turn about x, on a frame given by its axes."""
    c, s = math.cos(angle), math.sin(angle)
    for r in range(3):
        x[r], b, d = c * x[r] - s * y[r], s * x[r] + c * y[r], z[r]
        y[r], z[r] = -turn * d, turn * b


@compiled
def _clamped(value: float) -> float:
    """The value within -1 and 1; NaN when it is further outside than seeds may be."""
    return min(max(value, -1.0), 1.0) if abs(value) < 1.0 + _SLACK else math.nan


@compiled
def postures_at(target: Array, q7: float, out: Array) -> None:
    """Write the up to eight postures (8, 7) of a pose with the last joint at q7; NaN where none.

    Rows keep their meaning (elbow, wrist, shoulder) as q7 moves. A row slightly beyond the
    reach is the nearest one, not exact.
    """
    out[:] = math.nan
    c, s = math.cos(0.25 * math.pi - q7), math.sin(0.25 * math.pi - q7)
    x6, y6, z6 = np.empty(3), np.empty(3), np.empty(3)
    for r in range(3):
        x6[r] = c * target[r, 0] + s * target[r, 1]
        y6[r] = -target[r, 2]
    dx = dy = dz = square = 0.0
    for r in range(3):
        a, b = (r + 1) % 3, (r + 2) % 3
        z6[r] = x6[a] * y6[b] - x6[b] * y6[a]
        wrist = target[r, 3] + (_FLANGE + _TIP) * y6[r] - _OFFSETS[6, 0] * x6[r]
        shoulder = BASE[r] + (_OFFSETS[0, 2] if r == 2 else 0.0)
        dx += x6[r] * (shoulder - wrist)
        dy += y6[r] * (shoulder - wrist)
        dz += z6[r] * (shoulder - wrist)
        square += (shoulder - wrist) ** 2
    upper, fore, jog = _OFFSETS[2, 1], _OFFSETS[4, 1], _OFFSETS[3, 0]
    p, r4 = -jog * jog - fore * upper, jog * upper - fore * jog
    constant = upper**2 + fore**2 + 2.0 * jog**2
    bent = math.acos(_clamped((square - constant) / (2.0 * math.hypot(p, r4))))
    if math.isnan(bent):
        return
    x3, y3, z3 = np.empty(3), np.empty(3), np.empty(3)
    for row in range(4):
        q4 = math.atan2(r4, p) + (bent if row >= 2 else -bent)
        c, s = math.cos(q4), math.sin(q4)
        sx, sz = jog - jog * c + upper * s, jog * s + upper * c - fore
        sine = _clamped(dz / sx)
        if math.isnan(sine) or q4 < LOWER[3] - _SLACK or q4 > UPPER[3] + _SLACK:
            continue
        cosine = math.sqrt(1.0 - sine * sine) * (1.0 if row % 2 == 0 else -1.0)
        q5 = math.atan2(sine, cosine)
        q6 = math.atan2(sz, sx * cosine) - math.atan2(dy, dx)
        q6 -= 2.0 * math.pi * math.floor((q6 - 1.8675) / (2.0 * math.pi) + 0.5)
        if q6 < LOWER[5] - _SLACK or q6 > UPPER[5] + _SLACK:
            continue
        for r in range(3):
            x3[r], y3[r], z3[r] = x6[r], y6[r], z6[r]
        _unwind(x3, y3, z3, q6, 1.0)
        _unwind(x3, y3, z3, q5, -1.0)
        _unwind(x3, y3, z3, q4, 1.0)
        for flip in range(2):
            sign = 1.0 - 2.0 * flip
            one = out[2 * row + flip]
            one[0] = math.atan2(sign * z3[1], sign * z3[0])
            one[1] = sign * math.atan2(math.hypot(z3[0], z3[1]), z3[2])
            one[2] = math.atan2(sign * y3[2], -sign * x3[2])
            one[3], one[4], one[5], one[6] = q4, q5, q6, q7


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
            if outside <= _SLACK:
                costs[k, row] = cost(one) + 1e4 * outside


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
    if count == 0 and grid == _FINE_GRID and reaches(target, best) and _inside(best):
        count = _insert(best, found, ranks, count)
    return count


@compiled
def reaches(target: Array, q: Array) -> bool:
    """True when the joints bring the tip to the target within a micrometre and microradian."""
    frames, error = np.empty((FRAMES, 4, 4)), np.empty(6)
    fill_frames(q, frames)
    return not math.isnan(q[0]) and _fill_error(frames[TIP], target, error) < 1e-6


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


@compiled
def fill_matrix(pose: Array, matrix: Array) -> bool:
    """Write the transform (4, 4) of a pose; False when it is not finite or its quaternion is 0."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    size = x * x + y * y + z * z + w * w
    if not (1e-12 < size < 1e12 and abs(pose[0]) + abs(pose[1]) + abs(pose[2]) < 1e6):
        return False
    k = 2.0 / size
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = (
        1 - k * (y * y + z * z),
        k * (x * y - z * w),
        k * (x * z + y * w),
    )
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = (
        k * (x * y + z * w),
        1 - k * (x * x + z * z),
        k * (y * z - x * w),
    )
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = (
        k * (x * z - y * w),
        k * (y * z + x * w),
        1 - k * (x * x + y * y),
    )
    for r in range(3):
        matrix[r, 3], matrix[3, r] = pose[r], 0.0
    matrix[3, 3] = 1.0
    return True


@compiled
def fill_pose(matrix: Array, pose: Array) -> None:
    """Write the pose (7,) of a transform, with the quaternion's largest part positive."""
    a, b, c = matrix[0, 0], matrix[1, 1], matrix[2, 2]
    pose[:3] = matrix[:3, 3]
    square = np.array([1 + a - b - c, 1 - a + b - c, 1 - a - b + c, 1 + a + b + c])
    i = np.argmax(square)
    if i == 3:
        pose[3] = matrix[2, 1] - matrix[1, 2]
        pose[4] = matrix[0, 2] - matrix[2, 0]
        pose[5] = matrix[1, 0] - matrix[0, 1]
        pose[6] = square[3]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        pose[3 + i] = square[i]
        pose[3 + j] = matrix[j, i] + matrix[i, j]
        pose[3 + k] = matrix[k, i] + matrix[i, k]
        pose[6] = matrix[k, j] - matrix[j, k]
    size = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    for r in range(3, 7):
        pose[r] /= size


def as_array(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """A fresh float64 array of the given shape.

    Raises:
        ValueError: the values have another shape; the message names both.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, expected {shape}")
    return array


def pose_to_matrix(pose: ArrayLike) -> Array:
    """The transform (4, 4) of a pose (7,); its quaternion may have any length but zero.

    Raises:
        ValueError: the pose is not finite, its quaternion is zero, or it is not (7,).
    """
    matrix = np.empty((4, 4))
    if not fill_matrix(as_array(pose, (7,), "a pose"), matrix):
        raise ValueError(f"a pose needs finite numbers and a quaternion that is not zero: {pose!r}")
    return matrix


def matrix_to_pose(matrix: ArrayLike) -> Array:
    """The pose (7,) of a transform (4, 4); the largest part of its quaternion is positive."""
    pose = np.empty(7)
    fill_pose(as_array(matrix, (4, 4), "a transform"), pose)
    return pose


def link_frames(joints: ArrayLike) -> Array:
    """World frames (10, 4, 4) of the base, links 1 to 7, the hand and the tip."""
    frames = np.empty((FRAMES, 4, 4))
    fill_frames(as_array(joints, (7,), "joints"), frames)
    return frames


def tip_pose(joints: ArrayLike) -> Array:
    """World transform (4, 4) of the tip."""
    return np.asarray(link_frames(joints)[TIP])


def jacobian(joints: ArrayLike) -> Array:
    """Velocity of the tip per joint velocity (6, 7): linear above angular, in the world frame."""
    jac = np.empty((6, 7))
    fill_jacobian(link_frames(joints), jac)
    return jac


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
