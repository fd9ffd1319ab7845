"""A shallow square container."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box, shade
from hide_tasks.assets.colors import RGB
from hide_tasks.poses import point, yaw_of

SIDE = 0.16  # m
HEIGHT = 0.022  # m of its rim above the table
FLOOR = 0.008  # m
WALL = 0.008  # m
INSIDE = 0.12  # m above the floor that still counts as in it


@dataclass
class Tray(Asset):
    """An open tray, fixed to the table; its frame is the middle of its foot."""

    color: RGB = (96, 148, 190)
    radius = 0.115

    def __post_init__(self) -> None:
        self.links = (Link("tray", (self._floor(), *self._walls())),)

    def rest(self, height: float) -> tuple[float, float, float]:
        """The middle of a thing so high that stands in it."""
        x, y, z = point(self.at, 0, 0, FLOOR + height / 2).tolist()
        return x, y, z

    def contains(self, position: Sequence[float]) -> bool:
        """True when a point of the world is between its walls, not too high."""
        x, y, z = (p - q for p, q in zip(position, self.at[:3].tolist(), strict=True))
        if not 0.0 <= z <= INSIDE or math.hypot(x, y) > SIDE:
            return False
        yaw = yaw_of(self.at)
        along, across = math.cos(yaw) * x + math.sin(yaw) * y, math.cos(yaw) * y - math.sin(yaw) * x
        return bool(max(abs(along), abs(across)) <= SIDE / 2)

    def _floor(self) -> Shape:
        return box((SIDE, SIDE, FLOOR), (0, 0, FLOOR / 2), shade(self.color, 1.25))

    def _walls(self) -> tuple[Shape, ...]:
        away = (SIDE - WALL) / 2
        long, short = (SIDE, WALL, HEIGHT), (WALL, SIDE, HEIGHT)
        return (
            *(box(short, (s * away, 0, HEIGHT / 2), self.color, bevel=0.002) for s in (-1, 1)),
            *(box(long, (0, s * away, HEIGHT / 2), self.color, bevel=0.002) for s in (-1, 1)),
        )
