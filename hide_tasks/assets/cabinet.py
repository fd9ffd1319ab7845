"""A cabinet with two sliding doors that faces the robot; at most one door can be open."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Joint, Link, Shape, box, cylinder, shade
from hide_tasks.poses import Array, compose, pose, yaw_of

SIDES = ("left", "right")  # as the robot sees them; also the order in which the expert searches

# Metres. Wide and high enough for the hand: its palm is 20 cm wide.
WIDTH = 0.56  # across, along y
DEPTH = 0.22
PLINTH = 0.14  # under the shelf
ROOM = 0.24  # between shelf and top
WALL = 0.012
LEDGE = 0.034  # of shelf and top before the walls: the doors run between them
DOOR = 0.010  # thick
TRACK = 0.013  # from one door's plane to the other's
LAP = 0.006  # of either door over the middle
TRAVEL = 0.24
DETENT = 0.02  # below this opening a door snaps shut, so that no gap tells which one it was
HANDLES = 0.07  # of either handle before the front
BAR = 0.007  # radius of a handle's bar
BAR_LENGTH = 0.08
BAR_HEIGHT = 0.165  # of a handle's middle above the shelf
BAR_ASIDE = 0.255  # of a shut door's handle from the middle
PAINT = (196, 204, 206)
DOORS = (96, 140, 160)
METAL = (60, 62, 66)


@dataclass
class Door:
    """One door of a cabinet."""

    cabinet: "Cabinet"
    side: str

    @property
    def outward(self) -> int:
        """The way it runs when it shuts: 1 to the left, -1 to the right."""
        return 1 if self.side == "left" else -1

    @property
    def link(self) -> int:
        """Its link in the cabinet."""
        return 1 + SIDES.index(self.side)

    @property
    def opening(self) -> float:
        """How far it is open, m."""
        return self.cabinet.body.joint(self.link)

    @property
    def handle(self) -> Array:
        """The present pose of its handle's middle, x into the cabinet."""
        return compose(self.cabinet.pose(self.link), self.offset())

    def offset(self, opening: float = 0.0) -> Array:
        """Where its handle is in the cabinet's frame when it is open so far."""
        x = -DEPTH / 2 - HANDLES
        aside = self.outward * (BAR_ASIDE - opening)
        return pose(x, aside, PLINTH + BAR_HEIGHT)

    def plane(self) -> float:
        """The x of its middle: the left door runs before the right one."""
        return -DEPTH / 2 - 0.007 - (TRACK if self.side == "left" else 0.0)


@dataclass
class Cabinet(Asset):
    """A painted frame on a plinth. Its frame is the middle of its foot, x into the cabinet."""

    interlocked = True
    radius = 0.32

    def __post_init__(self) -> None:
        self.links = (Link("frame", self._frame_shapes()), *map(self._door, SIDES))

    def __getitem__(self, side: str) -> Door:
        return Door(self, side)

    def shelf(self, side: str, *, behind: float, aside: float) -> Array:
        """A pose on the shelf: m behind the front, m to the left of the middle of a side."""
        middle = WIDTH / 4 * (1 if side == "left" else -1)
        return self.frame(behind - DEPTH / 2, middle + aside, PLINTH + WALL)

    def contains(self, position: Sequence[float], radius: float) -> bool:
        """True when a round thing that stands at a point of the world is not quite out of it."""
        east, north = position[0] - self.at[0], position[1] - self.at[1]
        yaw = yaw_of(self.at)
        deep = east * math.cos(yaw) + north * math.sin(yaw)
        aside = north * math.cos(yaw) - east * math.sin(yaw)
        high = position[2] - self.at[2] - PLINTH
        along = deep + radius > -DEPTH / 2 - LEDGE and deep < DEPTH / 2 + radius
        across = abs(aside) < WIDTH / 2 + radius
        return bool(along and across and 0 < high < ROOM + 2 * WALL)

    def _frame_shapes(self) -> tuple[Shape, ...]:
        dark, middle = shade(PAINT, 0.85), PLINTH + WALL + ROOM / 2
        return (
            box((DEPTH, WIDTH, PLINTH), (0, 0, PLINTH / 2), shade(PAINT, 0.6), bevel=0.004),
            *(
                box((DEPTH + LEDGE, WIDTH, WALL), (-LEDGE / 2, 0, z), PAINT, bevel=0.002)
                for z in (PLINTH + WALL / 2, PLINTH + 1.5 * WALL + ROOM)
            ),
            box((WALL, WIDTH, ROOM), ((DEPTH - WALL) / 2, 0, middle), dark),
            *(
                box((DEPTH - WALL, WALL, ROOM), (-WALL / 2, aside, middle), dark)
                for aside in (-(WIDTH - WALL) / 2, 0.0, (WIDTH - WALL) / 2)
            ),
        )

    def _door(self, side: str) -> Link:
        door = Door(self, side)
        joint = Joint("slide", (0, -door.outward, 0), 0.0, TRAVEL, friction=3.0, detent=DETENT)
        width = WIDTH / 2 + LAP - 0.002
        aside = door.outward * (WIDTH / 2 - 0.002 - width / 2)
        center = (door.plane(), aside, PLINTH + WALL + ROOM / 2)
        color = shade(DOORS, 1.0 if side == "left" else 1.25)
        panel = box((DOOR, width, ROOM - 0.002), center, color, bevel=0.002)
        return Link(
            side,
            (panel, *_handle(door)),
            mass=0.6,
            joint=joint,
            graspable=True,
            friction=1.0,
        )


def _handle(door: Door) -> tuple[Shape, ...]:
    x, y, z = (float(value) for value in door.offset()[:3])
    foot = door.plane() - x
    along_x = (0.0, 0.7071067811865476, 0.0, 0.7071067811865476)
    return (
        cylinder(BAR, BAR_LENGTH, (x, y, z), METAL, bevel=0.002),
        *(
            cylinder(
                0.005,
                foot,
                (x + foot / 2, y, z + end * (BAR_LENGTH / 2 - 0.007)),
                METAL,
                rotation=along_x,
            )
            for end in (-1, 1)
        ),
    )
