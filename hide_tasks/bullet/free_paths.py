"""Is a path free of collisions?"""

from typing import NamedTuple

import numpy as np

from hide_tasks.bullet.collision import Body, Obstacles, spare
from hide_tasks.bullet.kernels import Array, compiled

_STRIDE = 0.01  # m that any part of the arm may move between two checks near an obstacle
_INTERVALS = 2048  # parts of one edge that may be looked at


class PlanningScene(NamedTuple):
    """What a motion must keep away from."""

    arm: Body
    boxes: Obstacles
    kept: Array  # (s, n) m, the distance that each sphere keeps from each box
    reach: Array  # (7,) m, the longest lever of each joint


@compiled
def edge_is_free(a: Array, b: Array, scene: PlanningScene) -> bool:
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
def path_is_free(path: Array, scene: PlanningScene) -> bool:
    """True when all edges of a path are free; that its first point is free is taken as given."""
    free = True
    for i in range(len(path) - 1):
        free = free and edge_is_free(path[i], path[i + 1], scene)
    return free
