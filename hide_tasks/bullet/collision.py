"""Does the arm touch anything? Spheres around the arm against oriented boxes.

About 200 spheres hold the surface of PyBullet's collision hulls (`make_panda_spheres`), so a
touch is never missed; they stand out by 3 to 8 mm at the gripper and up to 3 cm along the arm, so
a near miss may count as a touch. Distances are metres, negative inside; the base is not tested
against boxes, because it never moves.

`Obstacles` are n boxes. Held spheres (m, 4) are a centre in the tip's frame and a radius, for an
object in the hand. An opening is 0 (shut) to 1 (fingers 8 cm apart). A tolerance (s, n) is the
distance that each sphere must keep from each box.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hide_tasks.bullet.frames import FRAMES, HAND, TIP, fill_frames
from hide_tasks.bullet.kernels import Array, as_array, compiled

MARGIN = 0.004  # m that a path keeps from everything
SLACK = 0.002  # m that a pair which touches at the start may come closer still
_FINGER = 0.0584  # m from the hand to the fingers' frames, along z
_STROKE = 0.04  # m that each finger moves, along y
_ARM = 8  # frames before the hand's: what does not belong to the gripper


class Obstacles(NamedTuple):
    """n oriented boxes in the world."""

    centres: Array  # (n, 3) m
    rotations: Array  # (n, 3, 3), columns are the box's axes
    half_sizes: Array  # (n, 3) m


class Body(NamedTuple):
    """The spheres of the arm and of what it holds, grouped by the frame that moves them.

    Groups: base, links 1 to 7, hand, left finger, right finger, held; `bounds` holds one sphere
    around each group.
    """

    spheres: Array  # (s, 4): centre in the group's frame, radius
    starts: NDArray[np.int64]  # (13,): spheres of group g are starts[g]:starts[g + 1]
    bounds: Array  # (12, 4)
    opening: float  # 0 shut, 1 open


def _load() -> tuple[Array, NDArray[np.int64]]:
    with np.load(Path(__file__).with_name("panda_spheres.npz")) as file:
        return file["spheres"], file["frames"]


NO_SPHERES = np.empty((0, 4))
NOTHING = Obstacles(np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, 3)))

# Folded arms bring the gripper and the wrist to the base and the shoulder. The spheres of these
# links may overlap by so much (m) before their hulls do.
_MOVING = (6, 7, 8, 9, 10, 11)
_STANDING = (0, 1, 2)
_OVERLAP = 0.015


def body(opening: float = 1.0, held: ArrayLike = NO_SPHERES) -> Body:
    """The arm with its fingers at an opening and with held spheres (m, 4).

    Raises:
        ValueError: held spheres are not (m, 4) or not finite.
    """
    carried = np.array(held, dtype=np.float64).reshape(-1, 4) if np.size(held) else NO_SPHERES
    if not np.isfinite(carried).all():
        raise ValueError("held spheres must be finite: x y z in the tip's frame, radius")
    spheres = np.concatenate([_SPHERES, carried])
    starts = np.append(_STARTS, len(spheres))
    bounds = np.concatenate([_BOUNDS, _bound(carried)[None]])
    return Body(spheres, starts, bounds, float(min(max(opening, 0.0), 1.0)))


def _bound(spheres: Array) -> Array:
    """A sphere (4,) around spheres (k, 4)."""
    if not len(spheres):
        return np.zeros(4)
    radii = spheres[:, 3:]
    low, high = (spheres[:, :3] - radii).min(0), (spheres[:, :3] + radii).max(0)
    centre = (low + high) / 2
    reach = np.sqrt(((spheres[:, :3] - centre) ** 2).sum(1)) + spheres[:, 3]
    return np.append(centre, reach.max())


_SPHERES, _FRAMES_OF = _load()
_STARTS = np.searchsorted(_FRAMES_OF, np.arange(12))  # the last group is what is held
_BOUNDS = np.array([_bound(group) for group in np.split(_SPHERES, _STARTS[1:-1])])


@compiled
def place(q: Array, arm: Body, frames: Array, centres: Array, middles: Array) -> None:
    """Write the world's centres of the spheres (s, 3) and of the groups' bounds (12, 3)."""
    fill_frames(q, frames[:FRAMES])
    for g in range(len(middles)):
        frame = frames[HAND] if HAND <= g < len(middles) - 1 else frames[min(g, TIP)]
        y = z = 0.0
        if g == HAND + 1 or g == HAND + 2:
            y = _STROKE * arm.opening * (1.0 if g == HAND + 1 else -1.0)
            z = _FINGER
        _carry(frame, arm.bounds[g], y, z, middles[g])
        for s in range(arm.starts[g], arm.starts[g + 1]):
            _carry(frame, arm.spheres[s], y, z, centres[s])


@compiled
def _carry(frame: Array, point: Array, y: float, z: float, out: Array) -> None:
    for r in range(3):
        out[r] = frame[r, 3] + frame[r, 0] * point[0]
        out[r] += frame[r, 1] * (point[1] + y) + frame[r, 2] * (point[2] + z)


@compiled
def _gap(centre: Array, boxes: Obstacles, b: int) -> float:
    """Distance of a point from box b, negative inside."""
    outside, inside = 0.0, -1e9
    x = centre[0] - boxes.centres[b, 0]
    y = centre[1] - boxes.centres[b, 1]
    z = centre[2] - boxes.centres[b, 2]
    for k in range(3):
        along = x * boxes.rotations[b, 0, k] + y * boxes.rotations[b, 1, k]
        beyond = abs(along + z * boxes.rotations[b, 2, k]) - boxes.half_sizes[b, k]
        inside = max(inside, beyond)
        if beyond > 0.0:
            outside += beyond * beyond
    return math.sqrt(outside) if inside > 0.0 else inside


@compiled
def _far(point: Array, boxes: Obstacles, b: int, reach: float) -> bool:
    """True when a point is further than the reach from a sphere around box b."""
    square = size = 0.0
    for k in range(3):
        square += (point[k] - boxes.centres[b, k]) ** 2
        size += boxes.half_sizes[b, k] ** 2
    beyond = square - size - reach * reach  # > 2 reach sqrt(size) when out of reach
    return beyond > 0.0 and beyond * beyond > 4.0 * reach * reach * size


@compiled
def spare(q: Array, arm: Body, boxes: Obstacles, tolerance: Array, enough: float) -> float:
    """How far the arm may move before it breaks a tolerance or touches itself; negative: broken.

    Exact below `enough` (m), else at least that. Stops at the first broken tolerance.
    """
    frames = np.empty((FRAMES, 4, 4))
    centres, middles = np.empty((len(arm.spheres), 3)), np.empty((len(arm.bounds), 3))
    place(q, arm, frames, centres, middles)
    least = min(enough, 0.5 * self_gap(arm, centres, middles, 2.0 * enough))
    for g in range(1, len(middles)):
        first, last = arm.starts[g], arm.starts[g + 1]
        if first == last:
            continue
        for b in range(len(boxes.centres)):
            reach = arm.bounds[g, 3] + MARGIN + least
            if _far(middles[g], boxes, b, reach) or _gap(middles[g], boxes, b) >= reach:
                continue
            for s in range(first, last):
                here = _gap(centres[s], boxes, b) - arm.spheres[s, 3] - tolerance[s, b]
                least = min(least, here)
            if least < 0.0:
                return least
    return least


@compiled
def self_gap(arm: Body, centres: Array, middles: Array, enough: float) -> float:
    """Distance between the wrist, gripper or held spheres and the base or shoulder, m.

    Exact below `enough`, else at least that.
    """
    least = enough
    for g in _MOVING:
        if arm.starts[g] == arm.starts[g + 1]:
            continue
        for h in _STANDING:
            apart = _apart(middles[g], middles[h])
            if apart - arm.bounds[g, 3] - arm.bounds[h, 3] + _OVERLAP >= least:
                continue
            for s in range(arm.starts[g], arm.starts[g + 1]):
                for t in range(arm.starts[h], arm.starts[h + 1]):
                    reach = arm.spheres[s, 3] + arm.spheres[t, 3] - _OVERLAP
                    least = min(least, _apart(centres[s], centres[t]) - reach)
    return least


@compiled
def _apart(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def fill_distances(q: Array, arm: Body, boxes: Obstacles, out: Array) -> None:
    """Write the distance of every sphere from every box (s, n); the base's count as infinite."""
    frames = np.empty((FRAMES, 4, 4))
    centres, middles = np.empty((len(arm.spheres), 3)), np.empty((len(arm.bounds), 3))
    place(q, arm, frames, centres, middles)
    for s in range(len(centres)):
        for b in range(len(boxes.centres)):
            if s < arm.starts[1]:
                out[s, b] = math.inf
            else:
                out[s, b] = _gap(centres[s], boxes, b) - arm.spheres[s, 3]


def checked(boxes: Obstacles) -> Obstacles:
    """The boxes as contiguous float64 arrays.

    Raises:
        ValueError: the three arrays do not describe the same number of boxes.
    """
    n = len(boxes.centres)
    return Obstacles(
        as_array(boxes.centres, (n, 3), "centres"),
        as_array(boxes.rotations, (n, 3, 3), "rotations"),
        as_array(boxes.half_sizes, (n, 3), "half sizes"),
    )


def distances(joints: ArrayLike, arm: Body, boxes: Obstacles) -> Array:
    """Distance of every sphere from every box (s, n), m; infinite for the base's spheres."""
    out = np.empty((len(arm.spheres), len(boxes.centres)))
    fill_distances(as_array(joints, (7,), "joints"), arm, checked(boxes), out)
    return out


def strict(arm: Body, boxes: Obstacles) -> Array:
    """The tolerance (s, n) that keeps every sphere MARGIN away from every box."""
    return np.full((len(arm.spheres), len(boxes.centres)), MARGIN)


def tolerance(
    start: ArrayLike, arm: Body, boxes: Obstacles, *, gripper_only: bool = False
) -> Array:
    """The tolerance (s, n) of a motion from `start` (7,): MARGIN, less at boxes touched there.

    What touches a box already may come closer to it by SLACK but not dig in; the rest of the
    gripper may brush that box. `gripper_only` allows neither to the links.
    """
    kept, gaps = strict(arm, boxes), distances(start, arm, boxes)
    first = int(arm.starts[_ARM])
    gripper = np.arange(len(kept)) >= first
    near = gaps < MARGIN
    kept[np.ix_(gripper, near[first:].any(0))] = -SLACK
    allowed = near & gripper[:, None] if gripper_only else near
    return np.where(allowed, np.minimum(kept, gaps - SLACK), kept)


def clearance(
    joints: ArrayLike, opening: float, boxes: Obstacles, held_spheres: ArrayLike = NO_SPHERES
) -> float:
    """The least distance between the moving links, gripper or held spheres and a box, m.

    Negative when one is inside a box, infinite without boxes. At most the true distance.
    """
    gaps = distances(joints, body(opening, held_spheres), boxes)
    return float(gaps.min(initial=math.inf))


def touching(
    joints: ArrayLike,
    opening: float,
    boxes: Obstacles,
    held_spheres: ArrayLike = NO_SPHERES,
    *,
    margin: float = MARGIN,
) -> NDArray[np.bool_]:
    """Which boxes (n,) the arm is nearer to than the margin."""
    gaps = distances(joints, body(opening, held_spheres), boxes)
    return np.asarray((gaps < margin).any(0))


def collides(
    joints: ArrayLike,
    arm: Body,
    boxes: Obstacles,
    tolerance: Array | None = None,
) -> bool:
    """True when a sphere breaks its tolerance (default: MARGIN) or the arm touches itself."""
    kept = strict(arm, boxes) if tolerance is None else tolerance
    return bool(spare(as_array(joints, (7,), "joints"), arm, boxes, kept, 0.0) < 0.0)


def touches_itself(joints: ArrayLike, arm: Body) -> bool:
    """True when the wrist, gripper or held spheres meet the base or the shoulder."""
    return collides(joints, arm, NOTHING)
