"""Liquid: droplets that flow as balls, and its level in a cup as it is seen.

The picture shows a level in a cup that stands upright and droplets elsewhere, so that no
droplet's place tells how it came into the cup.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hide_tasks.assets.asset import Asset, Link, Shape, cylinder
from hide_tasks.assets.colors import RGB
from hide_tasks.assets.cup import Cup
from hide_tasks.poses import Array, compose, point, pose

RADIUS = 0.006  # m
MASS = 0.002  # kg
BLUE: RGB = (120, 190, 255)
FULL = 0.022  # m above a cup's floor that all droplets fill
EDGE = 0.001  # m between the level's disc and the cup's wall


@dataclass
class Droplet(Asset):
    """A ball that is drawn while it is in none of the cups that stand upright."""

    cups: Sequence[Cup] = ()
    avoided = False
    radius = RADIUS

    def __post_init__(self) -> None:
        ball = Shape("sphere", (RADIUS,), BLUE)
        self.links = (Link("droplet", (ball,), mass=MASS, friction=0.05, damping=0.1),)

    def drawn(self, link: int) -> Array | None:
        hidden = any(cup.upright and cup.holds(self.position) for cup in self.cups)
        return None if hidden else self.pose(link)


@dataclass
class Level(Asset):
    """The level of the liquid in a cup."""

    cup: Cup | None = None
    droplets: Sequence[Droplet] = ()
    avoided = False

    def __post_init__(self) -> None:
        assert self.cup is not None
        radius = self.cup.outer(self.cup.floor + FULL / 2) - self.cup.wall - EDGE
        disc = cylinder(radius, 0.001, (0, 0, 0), BLUE, solid=False)
        self.links = (Link("level", (disc,)),)

    def drawn(self, link: int) -> Array | None:
        assert self.cup is not None
        count = sum(self.cup.holds(droplet.position) for droplet in self.droplets)
        if not count or not self.cup.upright:
            return None
        high = self.cup.floor + FULL * count / len(self.droplets) - self.cup.height / 2
        return compose(self.cup.pose(), pose(0, 0, high))


def filling(cup: Cup, spread: Array) -> list[Array]:
    """Where droplets start in a cup, in rings of six; `spread` (n, 2), m, moves them apart."""
    room = cup.outer(cup.floor) - cup.wall - RADIUS - 0.0035
    found = []
    for i, (x, y) in enumerate(spread.tolist()):
        layer, turn = i // 6, 2 * np.pi * (i % 6 + 0.5 * (i // 6)) / 6
        high = cup.floor - cup.height / 2 + RADIUS * (1.2 + 2.4 * layer)
        at = point(cup.at, room * np.cos(turn) + x, room * np.sin(turn) + y, high)
        found.append(pose(*at.tolist()))
    return found
