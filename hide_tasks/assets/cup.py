"""A tapered cup: a round hollow to the eye, tilted boxes on a disc to the touch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hide_tasks.assets.asset import Asset, Link, Shape
from hide_tasks.assets.colors import COLORS, RGB
from hide_tasks.poses import multiply, quaternion, rotation_matrix

WALLS = 10  # boxes round the hollow
RAISED = 0.002  # m of the walls above the foot: the disc alone touches the table
SOLID = 0.0015  # m, the boxes' thickness; they end within the round wall


@dataclass
class Cup(Asset):
    """A cup that stands; its frame is on its axis, at its middle height."""

    color: str = "red"
    foot: float = 0.031  # m, outer radius below
    rim: float = 0.046  # m, outer radius above
    height: float = 0.10  # m
    floor: float = 0.022  # m of the hollow's floor above the foot
    wall: float = 0.0022  # m
    mass: float = 0.10  # kg
    friction: float = 0.3  # on its like it is the square: less than the slope of its wall
    radius = 0.046

    def __post_init__(self) -> None:
        color = COLORS[self.color]
        shapes = (self._seen(color), self._floor(color), *map(self._wall, range(WALLS)))
        self.links = (Link("cup", shapes, mass=self.mass, graspable=True, friction=self.friction),)

    def outer(self, height: float) -> float:
        """Its outer radius at a height above its foot, m."""
        return self.foot + (self.rim - self.foot) * height / self.height

    @property
    def upright(self) -> bool:
        """True while its axis is within 20 degrees of the vertical."""
        return bool(rotation_matrix(self.pose()[3:])[2, 2] > math.cos(math.radians(20)))

    def holds(self, position: Sequence[float]) -> bool:
        """True when a point of the world is in its hollow."""
        pose = self.pose()
        x, y, z = (rotation_matrix(pose[3:]).T @ (np.array(position) - pose[:3])).tolist()
        return math.hypot(x, y) < self.outer(z + self.height / 2) and abs(z) <= self.height / 2

    def standing_holds(self, positions: Sequence[tuple[float, float, float]]) -> int:
        """How many points of the world are in its hollow, if it stands; quick."""
        x, y, z = self.position
        low, high = z - self.height / 2, z + self.height / 2
        return sum(
            low < p[2] < high and math.hypot(p[0] - x, p[1] - y) < self.outer(p[2] - low)
            for p in positions
        )

    def _seen(self, color: RGB) -> Shape:
        low, high = -self.height / 2, self.height / 2
        hollow = self.outer(self.floor) - self.wall
        line = (
            (0.0, low),
            (self.foot, low),
            (self.rim, high),
            (self.rim - self.wall, high),
            (hollow, low + self.floor),
            (0.0, low + self.floor),
        )
        return Shape("lathe", tuple(v for p in line for v in p), color, solid=False)

    def _floor(self, color: RGB) -> Shape:
        radius = (self.foot - self.wall, self.floor)
        at = (0, 0, (self.floor - self.height) / 2, 0, 0, 0, 1)
        return Shape("cylinder", radius, color, at=at, seen=False)

    def _wall(self, number: int) -> Shape:
        turn = 2 * math.pi * number / WALLS
        tilt = math.atan2(self.rim - self.foot, self.height)
        high = (self.height - RAISED) / math.cos(tilt)
        middle = (self.height + RAISED) / 2
        away = self.outer(middle) * math.cos(math.pi / WALLS) - SOLID / 2 / math.cos(tilt)
        wide = 2 * self.outer(middle) * math.sin(math.pi / WALLS)
        place = (away * math.cos(turn), away * math.sin(turn), middle - self.height / 2)
        turned = multiply(quaternion(yaw=turn), quaternion(pitch=tilt))
        at = (*place, *turned.tolist())
        return Shape("box", (SOLID, wide, high), COLORS[self.color], at=at, seen=False)
