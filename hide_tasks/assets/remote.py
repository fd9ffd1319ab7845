"""A remote control with plus and minus buttons, and the mat that it belongs on."""

from dataclasses import dataclass
from typing import Literal

from hide_tasks.assets.asset import Asset, Joint, Link, Shape, box, cylinder
from hide_tasks.assets.colors import RGB
from hide_tasks.poses import Array

Sign = Literal["plus", "minus"]
SIGNS: tuple[Sign, ...] = ("plus", "minus")

LENGTH, WIDTH, HEIGHT = 0.216, 0.0512, 0.0185  # m; RLBench change_channel
MASS = 0.205  # kg
AHEAD = {"power": 0.065, "plus": 0.012, "minus": -0.048}  # m before the middle; a finger's room
CAP_RADIUS = 0.0165  # m; RLBench change_channel
CAP_RISE = 0.010  # m of a cap over the case: more than it travels
TRAVEL = 0.008  # m
SPRING = 5.0  # N
COUNTS_AT = 0.005  # m down: a press
COUNTS_AGAIN_AT = 0.002  # m: it must come up to here before the next press counts

CASE, FACE, SIGN = (34, 36, 42), (66, 70, 80), (250, 250, 250)
CAPS: dict[str, RGB] = {"plus": (40, 160, 80), "minus": (50, 110, 225), "power": (215, 40, 40)}

MAT_MARGIN = 0.014  # m of the mat round the remote
MAT, ARROW = (236, 236, 230), (120, 130, 150)


@dataclass
class Remote(Asset):
    """A remote control; its frame is its middle, x the way it points."""

    radius = 0.11

    def __post_init__(self) -> None:
        case = box((LENGTH, WIDTH, HEIGHT), (0, 0, 0), CASE, bevel=0.004)
        face = box((LENGTH - 0.02, WIDTH - 0.008, 0.002), (0, 0, HEIGHT / 2), FACE, solid=False)
        eye = box((0.004, 0.022, 0.009), (LENGTH / 2, 0, 0), CAPS["power"], solid=False)
        power = cylinder(0.012, 0.004, (AHEAD["power"], 0, _TOP), CAPS["power"], solid=False)
        base = Link("case", (case, face, eye, power), mass=MASS, graspable=True, friction=1.0)
        self.links = (base, *map(_cap, SIGNS))

    def travel(self, sign: Sign) -> float:
        """How far a cap is pressed, m, 0 at rest."""
        return -self.body.joint(1 + SIGNS.index(sign))


_TOP = HEIGHT / 2 + 0.002


def _cap(sign: Sign) -> Link:
    x, top = AHEAD[sign], HEIGHT / 2 + CAP_RISE
    cap = cylinder(CAP_RADIUS, CAP_RISE, (x, 0, HEIGHT / 2 + CAP_RISE / 2), CAPS[sign], bevel=0.002)
    across = box((0.005, 0.022, 0.002), (x, 0, top), SIGN, solid=False)
    along = box((0.022, 0.005, 0.002), (x, 0, top), SIGN, solid=False)
    marks: tuple[Shape, ...] = (across, along) if sign == "plus" else (across,)
    joint = Joint("slide", (0, 0, 1), -TRAVEL, 0.0, spring=SPRING)
    return Link(sign, (cap, *marks), mass=0.01, joint=joint)


@dataclass
class Mat(Asset):
    """Where the remote belongs, with an arrow the way it is to point; seen, not felt."""

    radius = 0.13

    def __post_init__(self) -> None:
        long, wide = LENGTH + 2 * MAT_MARGIN, WIDTH + 2 * MAT_MARGIN
        self.links = (
            Link(
                "mat",
                (
                    box((long, wide, 0.002), (0, 0, 0.001), MAT, solid=False),
                    *(
                        box((0.012, width, 0.002), (long / 2 + ahead, 0, 0.001), ARROW, solid=False)
                        for ahead, width in ((0.006, 0.06), (0.018, 0.04), (0.030, 0.02))
                    ),
                ),
            ),
        )

    @property
    def rest(self) -> Array:
        """The pose of a remote that lies on it and points as the arrow does."""
        return self.frame(0, 0, HEIGHT / 2)
