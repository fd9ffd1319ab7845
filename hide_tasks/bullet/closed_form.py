"""The postures of a pose with the last joint given, in closed form.

He and Liu, "Analytical inverse kinematics for Franka Emika Panda", 2021, solve the same geometry.
"""

import math

import numpy as np

from hide_tasks.bullet.frames import BASE, FLANGE, HAND_TO_TIP, OFFSETS
from hide_tasks.bullet.joint_space import LOWER, UPPER
from hide_tasks.bullet.kernels import Array, compiled

SLACK = 0.1  # a sample this far outside the limits or the reach may still lead inside


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
    return min(max(value, -1.0), 1.0) if abs(value) < 1.0 + SLACK else math.nan


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
        wrist = target[r, 3] + (FLANGE + HAND_TO_TIP) * y6[r] - OFFSETS[6, 0] * x6[r]
        shoulder = BASE[r] + (OFFSETS[0, 2] if r == 2 else 0.0)
        dx += x6[r] * (shoulder - wrist)
        dy += y6[r] * (shoulder - wrist)
        dz += z6[r] * (shoulder - wrist)
        square += (shoulder - wrist) ** 2
    upper, fore, jog = OFFSETS[2, 1], OFFSETS[4, 1], OFFSETS[3, 0]
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
        if math.isnan(sine) or q4 < LOWER[3] - SLACK or q4 > UPPER[3] + SLACK:
            continue
        cosine = math.sqrt(1.0 - sine * sine) * (1.0 if row % 2 == 0 else -1.0)
        q5 = math.atan2(sine, cosine)
        q6 = math.atan2(sz, sx * cosine) - math.atan2(dy, dx)
        q6 -= 2.0 * math.pi * math.floor((q6 - 1.8675) / (2.0 * math.pi) + 0.5)
        if q6 < LOWER[5] - SLACK or q6 > UPPER[5] + SLACK:
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
