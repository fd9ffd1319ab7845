"""Keyframe verbs for cups, taken by the rim: one finger within, one outside."""

import math
from collections.abc import Sequence

import numpy as np

from hide_tasks.assets.cup import Cup
from hide_tasks.motion.general import move, top_down
from hide_tasks.poses import Array
from hide_tasks.task import Move

DEPTH = 0.012  # m of the tip below the rim
SIDES = 8  # directions from the axis in which a rim may be taken
FINGER = 0.05  # m from the rim to the outer finger before it closes


def rim_at(position: Array, cup: Cup, side: float, *, height: float = 0.0) -> Array:
    """The tip pose at the rim of a cup whose middle is at a point (3,), or so high above it.

    `side` is the direction of the place on the rim from the axis, rad.
    """
    away = cup.rim - cup.wall / 2 - DEPTH * (cup.rim - cup.foot) / cup.height
    offset = np.array([away * math.cos(side), away * math.sin(side), cup.height / 2 - DEPTH])
    return top_down(position + offset + np.array([0, 0, height]), _folded(side - math.pi / 2))


def freest_side(cup: Cup, goal: Array, others: Sequence[Array]) -> float:
    """The side, rad, on which the outer finger is farthest from other things, here and there."""
    here = np.array(cup.position)
    near = [(here, goal), *((place, other) for place in (here, goal) for other in others)]

    def room(side: float) -> float:
        out = (cup.rim + FINGER) * np.array([math.cos(side), math.sin(side)])
        return min(float(np.linalg.norm(place[:2] + out - other[:2])) for place, other in near)

    return max((2 * math.pi * k / SIDES for k in range(SIDES)), key=room)


def rim_move(
    position: Array, cup: Cup, side: float, height: float, *, opened: bool, touching: bool = False
) -> Move:
    """To the rim of a cup whose middle is at a point (3,), or so high above it."""
    where = rim_at(position, cup, side, height=height)
    return move(lambda: where, opened=opened, touching=touching)


def _folded(yaw: float) -> float:
    """The equivalent turn of the gripper that is nearest to none: its fingers are alike."""
    return (yaw + math.pi / 2) % math.pi - math.pi / 2
