"""Paths with points so close together that the arm can be sent from one to the next."""

import math
from itertools import pairwise

import numpy as np

from hide_tasks.bullet.frames import tip_frame
from hide_tasks.bullet.joint_space import copy, largest_change
from hide_tasks.bullet.kernels import Array, compiled

JOINT_STEP = 0.03  # rad, the most that a joint moves between two points of a path
LINE_STEP = 0.01  # m, the same for the tip


def dense(path: Array) -> Array:
    """The path (n, 7) with points added until no step is longer than JOINT_STEP or LINE_STEP."""
    counts = np.array([_steps(a, b) for a, b in pairwise(path)])
    out = np.empty((int(counts.sum()) + 1, 7))
    fill_dense(path, counts, out)
    return out


@compiled
def _steps(a: Array, b: Array) -> int:
    """How many equal steps an edge needs: as many as its fastest part."""
    count = max(1, math.ceil(largest_change(a, b) / JOINT_STEP - 1e-9))
    before, longest, q = tip_frame(a), 0.0, np.empty(7)
    for i in range(count):
        for k in range(7):
            q[k] = a[k] + (b[k] - a[k]) * ((i + 1) / count)
        after = tip_frame(q)
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
    copy(path[len(path) - 1], out[n])
