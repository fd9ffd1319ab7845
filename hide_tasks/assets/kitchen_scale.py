"""A kitchen scale: a pan that feels its load, a dial with a needle that shows it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box, cylinder, shade
from hide_tasks.assets.colors import RGB
from hide_tasks.poses import Array, compose, point, pose, quaternion

BODY = (0.17, 0.18, 0.10)  # m; lower than RLBench's (0.207), so that a tool from above has room
PAN_RADIUS, PAN_HEIGHT = 0.085, 0.012  # m
PAN_TOP = BODY[2] + 0.012 + PAN_HEIGHT  # m above the table
DIAL_RADIUS = 0.062  # m
DIAL_TILT = math.radians(50)  # of the dial from facing up to facing away from the robot
DIAL_AT = (BODY[0] / 2 + 0.032, 0.0, 0.070)  # m
NEEDLE = (0.052, 0.009, 0.004)  # m
FULL = 3.0  # N at which the needle has turned all the way
SWEEP = math.radians(270)
DAMPING = 0.05  # share of the way to the load that the needle goes in a physics step
SAME = 0.05  # of the load: the needle shows it
LEAST = 0.2  # N: something is on the pan
PAN_LINK, NEEDLE_LINK = 1, 2
COAT: RGB = (64, 92, 110)
STEEL: RGB = (172, 176, 182)
PAPER: RGB = (244, 242, 234)
INK: RGB = (40, 40, 44)
RED: RGB = (214, 30, 30)


@dataclass
class KitchenScale(Asset):
    """Stands on the table, its dial away from the robot. Its frame is the middle of its foot."""

    shown: float = 0.0  # N that the needle shows
    steady: int = 0  # physics steps through which it has shown the load, nothing on it: 0
    radius = 0.15

    def __post_init__(self) -> None:
        dial = _tilted(*DIAL_AT)
        needle = box(NEEDLE, (NEEDLE[0] / 2 - 0.012, 0, 0), RED, solid=False)
        self.hub = compose(dial, pose(0, 0, 0.008))
        self.links = (
            Link("body", (*_body(), *_dial(dial))),
            Link("pan", _pan(), friction=1.0),
            Link("needle", (needle,)),
        )

    @property
    def top(self) -> Array:
        """The middle of its pan's upper side, pose (7,)."""
        return self.frame(0, 0, PAN_TOP)

    def carries(self, position: Sequence[float]) -> bool:
        """True when a point of the world is over the pan, not too high."""
        x, y, z = (p - q for p, q in zip(position, self.top[:3].tolist(), strict=True))
        return math.hypot(x, y) <= PAN_RADIUS and 0.0 <= z <= 0.1

    def act(self) -> None:
        """The needle follows the load."""
        load = self.body.load(PAN_LINK)
        self.shown += (load - self.shown) * DAMPING
        settled = load > LEAST and abs(self.shown - load) < SAME * load
        self.steady = self.steady + 1 if settled else 0

    def drawn(self, link: int) -> Array | None:
        if link != NEEDLE_LINK:
            return self.pose(link)
        angle = SWEEP * (0.5 - min(1.0, self.shown / FULL)) + math.pi
        return compose(compose(self.at, self.hub), pose(0, 0, 0, quaternion(yaw=angle)))


def _tilted(x: float, y: float, z: float) -> Array:
    return pose(x, y, z, quaternion(pitch=DIAL_TILT))


def _body() -> tuple[Shape, ...]:
    long, wide, high = BODY
    return (
        box(BODY, (0, 0, high / 2), COAT, bevel=0.008),
        box((0.06, wide, 0.02), (long / 2 + 0.03, 0, 0.01), COAT, bevel=0.006),
        cylinder(0.02, 0.014, (0, 0, high + 0.006), INK, solid=False),
    )


def _dial(dial: Array) -> tuple[Shape, ...]:
    def disc(radius: float, height: float, above: float, color: RGB) -> Shape:
        at = (*point(dial, 0, 0, above).tolist(), *dial[3:].tolist())
        return Shape("cylinder", (radius, height), color, at=at, solid=False)

    def mark(k: int) -> Shape:
        turn = SWEEP * (0.5 - k / 6) + math.pi
        place = compose(dial, pose(0, 0, 0.006, quaternion(yaw=turn)))
        at = (*point(place, 0.050, 0, 0).tolist(), *place[3:].tolist())
        return Shape("box", (0.014, 0.004, 0.002), INK, at=at, solid=False)

    guard = Shape("box", (0.10, 0.11, 0.03), COAT, at=tuple(dial.tolist()), seen=False)
    return (
        disc(DIAL_RADIUS + 0.006, 0.024, -0.010, shade(COAT, 0.7)),
        disc(DIAL_RADIUS, 0.004, 0.004, PAPER),
        disc(0.008, 0.010, 0.008, INK),
        *map(mark, range(7)),
        guard,
    )


def _pan() -> tuple[Shape, ...]:
    middle = PAN_TOP - PAN_HEIGHT / 2
    rim = cylinder(PAN_RADIUS + 0.004, 0.004, (0, 0, middle), shade(STEEL, 0.8), solid=False)
    return (cylinder(PAN_RADIUS, PAN_HEIGHT, (0, 0, middle), STEEL, bevel=0.003), rim)
