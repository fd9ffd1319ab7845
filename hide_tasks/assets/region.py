"""A marked place: seen, not felt."""

from dataclasses import dataclass

import numpy as np

from hide_tasks.assets.asset import Asset, Link, box
from hide_tasks.assets.colors import RGB
from hide_tasks.poses import Array, rotation_matrix


@dataclass
class Region(Asset):
    """A thin square mat that says where something goes."""

    side: float = 0.16  # m
    height: float = 0.075  # m above the mat that still counts as inside (RLBench detector)
    color: RGB = (120, 170, 120)

    def __post_init__(self) -> None:
        mat = box((self.side, self.side, 0.002), (0, 0, 0.001), self.color, solid=False)
        self.links = (Link("mat", (mat,)),)

    def contains(self, position: Array) -> bool:
        """True when a point (3,) of the world is over the mat and not too high."""
        local = rotation_matrix(self.at[3:]).T @ (position - self.at[:3])
        inside = np.abs(local[:2]) <= self.side / 2
        return bool(inside.all() and 0.0 <= local[2] <= self.height)
