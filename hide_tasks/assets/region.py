"""A marked place: seen, not felt."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, box
from hide_tasks.assets.colors import RGB
from hide_tasks.poses import yaw_of


@dataclass
class Region(Asset):
    """A thin square mat that says where something goes."""

    side: float = 0.16  # m
    height: float = 0.075  # m above the mat that still counts as inside (RLBench detector)
    color: RGB = (120, 170, 120)

    def __post_init__(self) -> None:
        mat = box((self.side, self.side, 0.002), (0, 0, 0.001), self.color, solid=False)
        self.links = (Link("mat", (mat,)),)

    def contains(self, position: Sequence[float]) -> bool:
        """True when a point of the world is over the mat and not too high."""
        above = position[2] - self.at[2]
        if not 0.0 <= above <= self.height:
            return False
        east, north = position[0] - self.at[0], position[1] - self.at[1]
        yaw = yaw_of(self.at)
        along = east * math.cos(yaw) + north * math.sin(yaw)
        across = north * math.cos(yaw) - east * math.sin(yaw)
        return bool(abs(along) <= self.side / 2 and abs(across) <= self.side / 2)
