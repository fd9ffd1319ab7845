"""Keyframe verbs for pouring: a cup held from its side, carried level, tipped over another."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hide_tasks.assets.cup import Cup
from hide_tasks.motion.general import toward
from hide_tasks.poses import (
    Array,
    compose,
    from_rotation_vector,
    multiply,
    pose,
    quaternion,
    rotation_matrix,
)
from hide_tasks.task import Arm

STANDOFF = 0.09  # m before a cup
LIFT = 0.125  # m (RLBench pour_from_cup_to_cup)
TILT = math.radians(118)
LIP_BEFORE = 0.033  # m of the tipped lip before the target's axis: a finger keeps off its rim
LIP_ABOVE = 0.035  # m of the tipped lip above the target's rim
DESCENT = 0.10  # m by which the cup sinks as it tips, so that its lip stays over the target
RISE = 0.05  # m above where it began to tip, when it is upright again


class Grip(NamedTuple):
    """How a cup is held."""

    heading: float  # rad, of the tool in the horizontal plane
    pitch: float  # rad, of the tool below it
    side: int  # it is tipped to the left (1) or to the right (-1) of the tool


GRIPS = tuple(
    Grip(math.radians(heading), math.radians(pitch), side)
    for heading, side in ((40, -1), (50, -1), (30, -1), (-40, 1), (20, -1), (-20, -1), (0, -1))
    for pitch in (15, 5, 25, 0, 35)
)


@dataclass(frozen=True)
class Pouring:
    """The tip poses of pouring from a cup into another, in one grip."""

    cup: Cup
    target: Cup
    grip: Grip

    def held(self, middle: Array, *, back: float = 0.0, up: float = 0.0) -> Array:
        """The tip holds the cup whose middle is at a point (3,), or is so far from there."""
        turned = quaternion(yaw=self.grip.heading)
        level = np.concatenate([middle + np.array([0, 0, up]), turned])
        return compose(toward(level, self.grip.pitch), pose(0, 0, -back))

    def ready(self) -> Array:
        """Over the target, upright."""
        return self.held(self._tipped_middle() + np.array([0, 0, DESCENT]))

    def tipped(self) -> Array:
        """Over the target, its lip over the target's hollow."""
        middle = self._tipped_middle()
        upright, turn = self.held(middle), self._turn()
        position = middle + rotation_matrix(turn) @ (upright[:3] - middle)
        return np.concatenate([position, multiply(turn, upright[3:])])

    def emptied(self) -> Array:
        """Over the target, upright again."""
        return self.held(self._tipped_middle() + np.array([0, 0, DESCENT + RISE]))

    def chain(self, start: Array, goal: Array) -> list[Array]:
        """All poses from before the cup at one point to letting go of it at another."""
        return [
            self.held(start, back=STANDOFF),
            self.held(start),
            self.held(start, up=LIFT),
            self.ready(),
            self.tipped(),
            self.emptied(),
            self.held(goal, up=LIFT),
            self.held(goal),
        ]

    def _turn(self) -> Array:
        heading = self.grip.heading
        along = np.array([math.cos(heading), math.sin(heading), 0.0])
        return from_rotation_vector(-self.grip.side * TILT * along)

    def _tipped_middle(self) -> Array:
        """Where the cup's middle is when its lip is where it should be."""
        half, radius = self.cup.height / 2, self.cup.rim
        ahead = radius * math.cos(TILT) + half * math.sin(TILT)
        over = half * math.cos(TILT) - radius * math.sin(TILT)
        heading, side = self.grip.heading, self.grip.side
        out = np.array([-math.sin(heading) * side, math.cos(heading) * side, 0.0])
        rim = self.target.at[:3] + np.array([0, 0, self.target.height / 2])
        middle: Array = rim - out * (LIP_BEFORE + ahead) + np.array([0, 0, LIP_ABOVE - over])
        return middle


def pouring_for(arm: Arm, cup: Cup, target: Cup, one: Array, two: Array) -> Pouring:
    """The first grip in which the arm can pour and carry the cup between two points, both ways."""
    found = [Pouring(cup, target, grip) for grip in GRIPS]

    def chains() -> Iterator[list[Array]]:
        return (p.chain(one, two) + p.chain(two, one) for p in found)

    return found[arm.first_feasible(chains())]
