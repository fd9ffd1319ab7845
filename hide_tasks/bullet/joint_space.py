"""The joint space of the arm: its limits, and the least that kernels do with joints (7,), rad."""

import numpy as np

from hide_tasks.bullet.kernels import Array, compiled

MARGIN = 0.02  # rad kept from Franka's soft limits
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]) + MARGIN
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]) - MARGIN


@compiled
def inside(q: Array) -> bool:
    """True when q is within the limits; what rounding put just beyond one is put on it."""
    for k in range(7):
        if not LOWER[k] - 1e-9 <= q[k] <= UPPER[k] + 1e-9:
            return False
        q[k] = min(max(q[k], LOWER[k]), UPPER[k])
    return True


@compiled
def largest_change(a: Array, b: Array) -> float:
    """How far the joint moves that moves most, rad."""
    most = 0.0
    for k in range(7):
        most = max(most, abs(b[k] - a[k]))
    return most


@compiled
def copy(source: Array, out: Array) -> None:
    """Write joints (7,) over others."""
    for k in range(7):
        out[k] = source[k]
