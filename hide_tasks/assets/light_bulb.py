"""A light bulb, the lamp that it is screwed into, and holders that keep it upright."""

import math
from dataclasses import dataclass, field

from hide_tasks.assets.asset import Asset, Link, Shape, cylinder, shade
from hide_tasks.assets.colors import COLORS, RGB
from hide_tasks.poses import Array, rotation_matrix, yaw_of

GLASS_RADIUS = 0.0342  # m; RLBench light_bulb_in: 0.0684 across
CAP_RADIUS, CAP_LENGTH = 0.0135, 0.024  # m of the screw cap below the glass
NECK = 0.045  # m from the middle of the ball down to the cap
MASS = 0.05  # kg
CLEAR, LIT, BRASS = (222, 232, 238), (255, 255, 0), (176, 150, 92)

HOLE = 0.017  # m from a hole's axis to its walls
HOLE_DEPTH = 0.026  # m: more than the cap is long, so that the neck rests on the edge
LAMP_HEIGHT = 0.305  # m of the socket's edge over the table; RLBench light_bulb_in
HOLDER_HEIGHT = 0.0525  # m; RLBench light_bulb_in
HOLDER_RADIUS = 0.0497  # m of its foot
STANDS = NECK + 0.0005  # m of a bulb's middle over the edge of what it stands in
LAMP, SOCKET = (52, 56, 66), (196, 198, 204)

NEAR = 0.01  # m from its seat that a turning bulb is in the thread
UPRIGHT = math.cos(0.35)  # of its axis to the vertical, at least
SCREWED = math.radians(150)  # clockwise, seen from above, until it has contact


@dataclass
class Bulb(Asset):
    """A light bulb, its cap down; its frame is the middle of its glass."""

    lit: bool = field(init=False, default=False)
    radius = GLASS_RADIUS

    def __post_init__(self) -> None:
        ball = Shape("sphere", (GLASS_RADIUS,), CLEAR, seen=False)
        neck = Shape(
            "cylinder", (0.020, 0.006), CLEAR, (0, 0, 0.003 - NECK, 0, 0, 0, 1), seen=False
        )
        cap = (0, 0, -NECK - CAP_LENGTH / 2)
        solid = cylinder(CAP_RADIUS, CAP_LENGTH, cap, BRASS)
        dark = (ball, neck, solid, Shape("lathe", _glass(), CLEAR, solid=False))
        screw = cylinder(CAP_RADIUS, CAP_LENGTH, cap, BRASS, solid=False)
        light = (screw, Shape("lathe", _glass(), LIT, solid=False))
        self.links = (
            Link("dark", dark, mass=MASS, graspable=True, friction=1.0),
            Link("lit", light, mass=0.001),
        )

    def drawn(self, link: int) -> Array | None:
        """The dark bulb or the lit one."""
        return self.pose() if self.lit == (link == 1) else None


def _glass() -> tuple[float, ...]:
    """Radii and heights of the glass: a ball that narrows to the cap."""
    neck = (0.0, -NECK, CAP_RADIUS, -NECK, 0.017, -0.038, 0.024, -0.028)
    angles = [math.radians(angle) for angle in range(-30, 90, 15)]
    ball = [(GLASS_RADIUS * math.cos(a), GLASS_RADIUS * math.sin(a)) for a in angles]
    return (*neck, *(value for at in ball for value in at), 0.0, GLASS_RADIUS)


@dataclass
class Lamp(Asset):
    """A lamp with its socket on top; its frame is the middle of its foot.

    The bulb lights when it is screwed in while the gripper holds it, and goes out when it is
    taken out.
    """

    bulb: Bulb
    turned: float = field(init=False, default=0.0)  # rad clockwise, since the bulb came in
    radius = 0.06

    def __post_init__(self) -> None:
        top = LAMP_HEIGHT - HOLE_DEPTH
        self.links = (
            Link(
                "lamp",
                (
                    cylinder(0.055, 0.022, (0, 0, 0.011), LAMP, bevel=0.004),
                    cylinder(0.014, top - 0.02, (0, 0, top / 2 + 0.01), LAMP),
                    *_collar(LAMP_HEIGHT, 0.012, SOCKET),
                ),
            ),
        )
        self._heading: float | None = None

    @property
    def seat(self) -> Array:
        """Where a bulb's middle is when it is screwed in."""
        return self.frame(0, 0, LAMP_HEIGHT + STANDS)

    def has(self, bulb: Bulb) -> bool:
        """True while a bulb is in the thread."""
        upright = rotation_matrix(bulb.pose()[3:])[2, 2] > UPRIGHT
        return bool(upright and math.dist(bulb.position, self.seat[:3]) < NEAR)

    def act(self) -> None:
        """Count the turns of a bulb in the thread; light it, or let it go out."""
        if not self.has(self.bulb):
            self.turned, self._heading, self.bulb.lit = 0.0, None, False
            return
        heading = yaw_of(self.bulb.pose()) if self.bulb.body.held() else None
        if heading is not None and self._heading is not None:
            self.turned += (self._heading - heading + math.pi) % (2 * math.pi) - math.pi
        self._heading = heading
        self.bulb.lit |= self.turned >= SCREWED


@dataclass
class Holder(Asset):
    """A coloured stand for one bulb; its frame is the middle of its foot."""

    color: str
    radius = HOLDER_RADIUS

    def __post_init__(self) -> None:
        color = COLORS[self.color]
        foot = cylinder(HOLDER_RADIUS, 0.0224, (0, 0, 0.0112), color, bevel=0.004)
        self.links = (Link("holder", (foot, *_collar(HOLDER_HEIGHT, 0.010, shade(color, 0.8)))),)

    @property
    def seat(self) -> Array:
        """Where a bulb's middle is when it stands here."""
        return self.frame(0, 0, HOLDER_HEIGHT + STANDS)


def _collar(height: float, thick: float, color: RGB) -> tuple[Shape, ...]:
    """A round collar about a hole, seen; four walls, felt."""
    low, outer = height - HOLE_DEPTH, HOLE + thick
    looks = (outer, low, outer, height, HOLE, height, HOLE, low + 0.002, 0.0, low + 0.002)
    walls = tuple(
        Shape("box", size, color, at=(*center, 0, 0, 0, 1), seen=False)
        for side in (-1, 1)
        for size, center in (
            (
                (thick, 2 * outer, HOLE_DEPTH),
                (side * (HOLE + thick / 2), 0.0, height - HOLE_DEPTH / 2),
            ),
            (
                (2 * HOLE, thick, HOLE_DEPTH),
                (0.0, side * (HOLE + thick / 2), height - HOLE_DEPTH / 2),
            ),
        )
    )
    return (Shape("lathe", (0.0, low, *looks), color, solid=False), *walls)
