"""A crumpled sheet of paper and the bin that it belongs in."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box
from hide_tasks.poses import point, quaternion, yaw_of

WIDTH = 0.052  # m of the paper where the fingers take it; RLBench's 0.084 is more than they open
HEIGHT = 0.042  # m; RLBench put_rubbish_in_bin 0.04
FOLDS = (  # side of a fold, m; where its middle is; how it is turned: roll, pitch, yaw, rad
    (0.040, (0.000, 0.000, 0.000), (0.2, 0.3, 0.1)),
    (0.032, (0.014, 0.008, 0.002), (0.9, 0.2, 0.7)),
    (0.030, (-0.014, 0.009, -0.002), (0.3, 0.8, 1.3)),
    (0.030, (0.006, -0.015, 0.001), (0.6, 0.6, 0.3)),
    (0.026, (-0.010, -0.012, 0.005), (1.2, 0.4, 0.5)),
    (0.026, (0.002, 0.004, 0.011), (0.7, 0.7, 1.0)),
)
PAPERS = ((250, 250, 246), (226, 227, 226), (240, 239, 233), (212, 214, 216))

BIN_SIDE = 0.20  # m; RLBench put_rubbish_in_bin
BIN_HEIGHT = 0.19  # m
BIN_WALL = 0.008  # m
BIN, RIM = (58, 70, 92), (150, 160, 176)


@dataclass
class Paper(Asset):
    """A crumpled sheet; its frame is its middle."""

    radius = 0.04

    def __post_init__(self) -> None:
        core = Shape("box", (WIDTH, WIDTH, HEIGHT), PAPERS[0], seen=False)
        folds = tuple(fold(i) for i in range(len(FOLDS)))
        self.links = (Link("paper", (core, *folds), mass=0.03, graspable=True),)


def fold(number: int, along: float = 0.0) -> Shape:
    """One of a sheet's folds, so far along it, m."""
    side, (x, y, z), (roll, pitch, yaw) = FOLDS[number]
    turned = quaternion(roll=roll, pitch=pitch, yaw=yaw).tolist()
    color = PAPERS[number % len(PAPERS)]
    return Shape(
        "box", (side, side * 0.9, side * 0.8), color, at=(x + along, y, z, *turned), solid=False
    )


@dataclass
class Bin(Asset):
    """An open bin; its frame is the middle of its foot."""

    radius = 0.15

    def __post_init__(self) -> None:
        floor = box((BIN_SIDE, BIN_SIDE, BIN_WALL), (0, 0, BIN_WALL / 2), BIN)
        self.links = (Link("bin", (floor, *self._sides(0.0, BIN_HEIGHT), *self._rim())),)

    def contains(self, position: Sequence[float]) -> bool:
        """True when a point of the world is between the walls and under the rim."""
        x, y, z = self.at[:3]
        if not 0.0 <= position[2] - z <= BIN_HEIGHT:
            return False
        yaw = yaw_of(self.at)
        east, north = position[0] - x, position[1] - y
        along = east * math.cos(yaw) + north * math.sin(yaw)
        across = north * math.cos(yaw) - east * math.sin(yaw)
        return bool(max(abs(along), abs(across)) <= BIN_SIDE / 2)

    @property
    def mouth(self) -> Sequence[float]:
        """The middle of its opening."""
        x, y, z = point(self.at, 0, 0, BIN_HEIGHT)
        return float(x), float(y), float(z)

    def _sides(self, low: float, high: float) -> tuple[Shape, ...]:
        off, middle, tall = (BIN_SIDE - BIN_WALL) / 2, (low + high) / 2, high - low
        return tuple(
            box(size, center, BIN)
            for side in (-1, 1)
            for size, center in (
                ((BIN_WALL, BIN_SIDE, tall), (side * off, 0, middle)),
                ((BIN_SIDE, BIN_WALL, tall), (0, side * off, middle)),
            )
        )

    def _rim(self) -> tuple[Shape, ...]:
        off, thick = BIN_SIDE / 2, 0.014
        sizes = {True: (thick, BIN_SIDE + thick, thick), False: (BIN_SIDE + thick, thick, thick)}
        return tuple(
            box(
                sizes[lengthwise],
                (side * off * lengthwise, side * off * (not lengthwise), BIN_HEIGHT),
                RIM,
                bevel=0.003,
                solid=False,
            )
            for side in (-1, 1)
            for lengthwise in (True, False)
        )
