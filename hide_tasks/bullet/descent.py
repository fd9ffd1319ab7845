"""Newton's method on the curve of postures of a pose, inside the limits of the joints."""

import math

import numpy as np

from hide_tasks.bullet.frames import FRAMES, TIP, fill_frames, fill_jacobian
from hide_tasks.bullet.joint_space import LOWER, UPPER, inside
from hide_tasks.bullet.kernels import Array, compiled

_STEP = 0.4  # rad, the longest step of one iteration
_OFF = 0.02  # m or rad off the curve after a step: the next is half as long
_ITERATIONS = 40
_PATIENCE = 5  # iterations without a posture inside the limits in sight
_CONVERGED = 1e-9  # rad, the last step of an iteration that counts as converged


@compiled
def fill_error(tip: Array, target: Array, error: Array) -> float:
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
        off = fill_error(frames[TIP], target, error)
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
            return inside(q)
    return False
