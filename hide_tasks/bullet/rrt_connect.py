"""RRT-Connect: a search for a free path from both its ends, with shortcuts of what it finds."""

import math

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.free_paths import PlanningScene, edge_is_free
from hide_tasks.bullet.joint_space import LOWER, UPPER, copy
from hide_tasks.bullet.kernels import Array, compiled

SAMPLES = 5000  # of the search before it gives up
SHORTCUTS = 60
_EXTEND = 0.4  # rad, the step of the search

Counts = NDArray[np.int64]
State = NDArray[np.uint64]


@compiled
def search(start: Array, goal: Array, scene: PlanningScene, seed: np.uint64, path: Array) -> int:
    """RRT-Connect (Kuffner and LaValle 2000): write the corners of a path, count them; 0: none."""
    size = len(path) // 2 - SHORTCUTS
    state = np.array([seed], dtype=np.uint64)
    trees, parents = np.empty((2, size, 7)), np.empty((2, size), dtype=np.int64)
    counts = np.ones(2, dtype=np.int64)
    copy(start, trees[0, 0])
    copy(goal, trees[1, 0])
    parents[0, 0] = parents[1, 0] = -1
    target, new = np.empty(7), np.empty(7)
    for turn in range(SAMPLES):
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
def _grow(tree: Array, parent: Counts, counts: Counts, which: int, near: int, q: Array) -> None:
    copy(q, tree[counts[which]])
    parent[counts[which]] = near
    counts[which] += 1


@compiled
def _connect(
    tree: Array, parent: Counts, counts: Counts, which: int, goal: Array, scene: PlanningScene
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
        copy(trees[0, node], path[length - 1 - i])
        node = parents[0, node]
    node = parents[1, second]
    while node >= 0:
        copy(trees[1, node], path[length])
        length += 1
        node = parents[1, node]
    return length


@compiled
def _shorten(path: Array, length: int, scene: PlanningScene, state: State) -> int:
    """Cut corners between random points of the path; its new number of points."""
    a, b, after = np.empty(7), np.empty(7), np.empty(path.shape)
    for _ in range(SHORTCUTS):
        x, y = _draw(state) * (length - 1), _draw(state) * (length - 1)
        x, y = min(x, y), max(x, y)
        i, j = int(x), int(y)
        _along(path, x, a)
        _along(path, y, b)
        if i == j or not edge_is_free(a, b, scene):
            continue
        for n in range(j + 1, length):
            copy(path[n], after[n])
        copy(a, path[i + 1])
        copy(b, path[i + 2])
        for n in range(j + 1, length):
            copy(after[n], path[n + i + 2 - j])
        length += i + 2 - j
    return length


@compiled
def _along(path: Array, where: float, out: Array) -> None:
    """Write the point between two corners of a path."""
    i = int(where)
    for k in range(7):
        out[k] = path[i, k] + (where - i) * (path[i + 1, k] - path[i, k])
