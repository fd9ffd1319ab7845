"""A sponge, and dirt that goes where it is wiped over."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hide_tasks.assets.asset import Asset, Link, Shape, box
from hide_tasks.poses import Array, rotation_matrix

LENGTH, WIDTH, HEIGHT = 0.125, 0.058, 0.033  # m; RLBench wipe_desk
PAD = 0.010  # m of the scouring pad under it
REACH = (0.050, 0.021)  # m either way that its underside wipes (RLBench's sensor 0.1 x 0.042)
LOW = 0.008  # m under it that it wipes (RLBench's sensor)
FOAM, SCOUR = (255, 214, 64), (40, 140, 70)

SPOT = (0.011, 0.009, 0.0016)  # m; RLBench's 0.005 are less than a pixel
DIRT = (148, 74, 0)  # RLBench wipe_desk: 0.58 0.29 0


@dataclass
class Spot(Asset):
    """A spot of dirt, there until it is wiped away: seen, not felt."""

    wiped: bool = field(init=False, default=False)
    avoided = False
    radius = 0.005

    def __post_init__(self) -> None:
        self.links = (Link("spot", (box(SPOT, (0, 0, SPOT[2] / 2), DIRT, solid=False),)),)

    def drawn(self, link: int) -> Array | None:
        """Where it lies; None once it is wiped away."""
        return None if self.wiped else self.at


@dataclass
class Film(Spot):
    """A spot of what is too clear to be seen."""

    def drawn(self, link: int) -> Array | None:
        """Nowhere."""
        return None


@dataclass
class Sponge(Asset):
    """A sponge with a scouring pad; its frame is its middle, x along its length.

    It wipes away the spots that it passes over.
    """

    spots: Sequence[Spot]
    radius = 0.07

    def __post_init__(self) -> None:
        foam = box((LENGTH, WIDTH, HEIGHT - PAD), (0, 0, PAD / 2), FOAM, bevel=0.004, solid=False)
        below = (PAD - HEIGHT) / 2
        pad = box((LENGTH, WIDTH, PAD), (0, 0, below), SCOUR, bevel=0.002, solid=False)
        body = Shape("box", (LENGTH, WIDTH, HEIGHT), FOAM, seen=False)
        link = Link("sponge", (body, foam, pad), mass=0.03, graspable=True, friction=0.5)
        self.links = (link,)
        self.left = len(self.spots)  # how many are not wiped away
        self._was_at: Sequence[float] = ()

    def act(self) -> None:
        """Wipe away what it is over, if it has moved."""
        position = self.position
        if position != self._was_at and position[2] < self.at[2] + LOW:
            self._was_at = position
            for spot, wiped in zip(self.spots, self._over(), strict=True):
                spot.wiped |= bool(wiped)
            self.left = sum(not spot.wiped for spot in self.spots)

    def _over(self) -> Array:
        pose = self.pose()
        points = np.array([spot.at[:3] for spot in self.spots])
        x, y, z = ((points - pose[:3]) @ rotation_matrix(pose[3:])).T
        under = (z <= 0) & (z >= -HEIGHT / 2 - LOW)
        return np.asarray((abs(x) <= REACH[0]) & (abs(y) <= REACH[1]) & under)
