"""A round coaster for a cup."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, cylinder, shade
from hide_tasks.assets.colors import RGB

RADIUS = 0.05  # m
HEIGHT = 0.006  # m
NEAR = 0.03  # m of a cup's axis from the middle: it stands on the coaster
FLAT = 0.005  # m, less than the floor of a cup that could stand between them
CORK: RGB = (168, 112, 66)


@dataclass
class Coaster(Asset):
    """A disc, fixed to the table; its frame is the middle of its foot."""

    radius = RADIUS

    def __post_init__(self) -> None:
        middle = (0, 0, HEIGHT / 2)
        ring = cylinder(RADIUS * 0.72, 0.001, (0, 0, HEIGHT), shade(CORK, 1.3), solid=False)
        self.links = (Link("coaster", (cylinder(RADIUS, HEIGHT, middle, CORK, bevel=0.002), ring)),)

    def carries(self, position: Sequence[float], height: float) -> bool:
        """True when a thing of that height, its middle at a point of the world, stands on it."""
        x, y, z = (p - q for p, q in zip(position, self.at[:3].tolist(), strict=True))
        return math.hypot(x, y) <= NEAR and abs(z - HEIGHT - height / 2) < FLAT
