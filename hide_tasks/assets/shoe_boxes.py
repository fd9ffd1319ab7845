"""Two shoe boxes side by side with hinged lids, at most one open, and the shoes."""

import math
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Joint, Link, Shape, box, shade
from hide_tasks.poses import Array, compose, pose, quaternion

SIDES = ("left", "right")  # as the robot sees them; also the order in which the expert searches

# Boxes, metres. Lower than the palm of a hand that holds a shoe.
LENGTH, WIDTH, HEIGHT = 0.17, 0.30, 0.085  # along x, y, z
ASIDE = 0.19  # of a box's middle from the middle of both
WALL = 0.006
LID = 0.006
BRIM = 0.004  # of a lid over the walls
APRON = 0.022  # of a lid down its sides
HINGE = (LENGTH / 2, HEIGHT + 0.001)  # x, z
TAB, TAB_SLOPE = 0.042, math.radians(45)  # of the lid's tab: fingers slip under it
OPENS = 1.70  # rad: a little over the upright, where it stays
DETENT, SNAP = 0.03, 0.3  # rad; N m that two fingers overcome
CARDBOARD = (198, 120, 60)
INSIDE = (236, 226, 206)
LIDS = (150, 62, 40)

# Shoes, metres.
SOLE = (0.12, 0.046, 0.014)
HEEL = (0.034, 0.048, 0.018)
TOE = (0.07, 0.042, 0.022)
SHAFT = (0.05, 0.042, 0.05)
STANDS = 0.027  # of the frame over what the shoe stands on
LEATHER = (40, 90, 170)
RUBBER = (34, 32, 36)
LACES = (245, 245, 240)


@dataclass
class Lid:
    """One box and its lid."""

    boxes: "ShoeBoxes"
    side: str

    @property
    def link(self) -> int:
        """The lid's link."""
        return 1 + SIDES.index(self.side)

    @property
    def aside(self) -> float:
        """The y of the box's middle."""
        return ASIDE if self.side == "left" else -ASIDE

    @property
    def opening(self) -> float:
        """How far it is open, rad."""
        return self.boxes.body.joint(self.link)

    @property
    def hinge(self) -> Array:
        """The middle of the hinge, x away from the robot."""
        return self.boxes.frame(HINGE[0], self.aside, HINGE[1])

    def floor(self, along: float, aside: float) -> Array:
        """A pose on the box's floor, m from its middle."""
        return self.boxes.frame(along, self.aside + aside, WALL)


@dataclass
class ShoeBoxes(Asset):
    """Two boxes fixed to the table. Its frame is the middle between them on the table."""

    interlocked = True
    radius = 0.36

    def __post_init__(self) -> None:
        walls = tuple(shape for side in SIDES for shape in _walls(self[side].aside))
        self.links = (Link("boxes", walls), *map(self._lid, SIDES))

    def __getitem__(self, side: str) -> Lid:
        return Lid(self, side)

    def _lid(self, side: str) -> Link:
        aside = self[side].aside
        x, z = HINGE
        joint = Joint(
            "hinge",
            (0, 1, 0),
            0.0,
            OPENS,
            friction=0.01,
            detent=DETENT,
            snap=SNAP,
            origin=(x, aside, z),
        )
        return Link(side, tuple(_lid(aside)), mass=0.12, joint=joint, friction=0.2)


def _walls(aside: float) -> list[Shape]:
    dark = shade(CARDBOARD, 0.9)
    high = HEIGHT - WALL
    return [
        box((LENGTH, WIDTH, WALL), (0, aside, WALL / 2), INSIDE),
        *(
            box((WALL, WIDTH, high), (end * (LENGTH - WALL) / 2, aside, WALL + high / 2), CARDBOARD)
            for end in (-1, 1)
        ),
        *(
            box(
                (LENGTH - 2 * WALL, WALL, high),
                (0, aside + end * (WIDTH - WALL) / 2, WALL + high / 2),
                dark,
            )
            for end in (-1, 1)
        ),
    ]


def _lid(aside: float) -> list[Shape]:
    front = HINGE[0] - LENGTH - BRIM
    level = HINGE[1] + LID / 2
    dark = shade(LIDS, 0.85)
    depth, width = LENGTH + BRIM, WIDTH + 2 * BRIM
    return [
        box((depth, width, LID), (HINGE[0] - depth / 2, aside, level), LIDS, bevel=0.002),
        _tab(front, aside, level),
        *(
            Shape("box", (depth, 0.003, APRON), dark, at=_at(HINGE[0] - depth / 2, y), solid=False)
            for y in (aside - width / 2, aside + width / 2)
        ),
    ]


def _at(x: float, y: float) -> tuple[float, ...]:
    return (x, y, HINGE[1] + LID - APRON / 2, 0, 0, 0, 1)


def _tab(front: float, aside: float, level: float) -> Shape:
    root = pose(front, aside, level, quaternion(pitch=TAB_SLOPE))
    middle = compose(root, pose(-TAB / 2, 0, 0))
    return Shape("box", (TAB, 0.07, 0.005), LACES, at=tuple(map(float, middle)), bevel=0.001)


@dataclass
class Shoe(Asset):
    """A loose shoe, its toe along -x. Its frame is the middle of its shaft over the sole."""

    mass: float = 0.12  # kg

    def __post_init__(self) -> None:
        self.links = (Link("shoe", _shoe(), mass=self.mass, graspable=True, friction=1.0),)


def _shoe() -> tuple[Shape, ...]:
    ground, heel = -STANDS, SOLE[0] / 2 - 0.03
    top = ground + SOLE[2]
    dark = shade(LEATHER, 0.8)
    return (
        box(SOLE, (heel - SOLE[0] / 2 + 0.026, 0, ground + SOLE[2] / 2), RUBBER, bevel=0.003),
        box(HEEL, (heel + 0.01, 0, ground + HEEL[2] / 2), shade(RUBBER, 1.6), bevel=0.002),
        box(TOE, (heel - 0.058, 0, top + TOE[2] / 2), LEATHER, bevel=0.006),
        box(SHAFT, (heel, 0, top + SHAFT[2] / 2), LEATHER, bevel=0.004),
        box((0.034, 0.028, 0.002), (heel, 0, top + SHAFT[2]), shade(dark, 0.3), solid=False),
        *(
            box(
                (0.006, 0.034, 0.003),
                (heel - 0.036 - 0.012 * k, 0, top + TOE[2]),
                LACES,
                solid=False,
            )
            for k in range(3)
        ),
    )
