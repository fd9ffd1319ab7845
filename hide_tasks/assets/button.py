"""A push button: a coloured plate with a cap that springs back."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Joint, Link, box, cylinder
from hide_tasks.assets.colors import COLORS
from hide_tasks.poses import Array

PLATE = 0.10  # m, square; RLBench push_button
PLATE_HEIGHT = 0.02  # m
CAP_RADIUS = 0.028  # m
CAP_RISE = 0.012  # m of the cap above its plate
TRAVEL = 0.008  # m
SPRING = 5.0  # N
COUNTS_AT = 0.005  # m down: a press (design.md 3)
COUNTS_AGAIN_AT = 0.002  # m: it must come up to here before the next press counts


@dataclass
class Button(Asset):
    """A push button that stands on the table."""

    color: str
    radius = 0.072

    def __post_init__(self) -> None:
        color = COLORS[self.color]
        ring = (225, 225, 225) if self.color != "white" else (90, 90, 90)
        top = PLATE_HEIGHT
        self.links = (
            Link(
                "plate",
                (
                    box((PLATE, PLATE, PLATE_HEIGHT), (0, 0, top / 2), color, bevel=0.003),
                    cylinder(CAP_RADIUS + 0.007, 0.003, (0, 0, top + 0.001), ring, solid=False),
                ),
            ),
            Link(
                "cap",
                (cylinder(CAP_RADIUS, CAP_RISE, (0, 0, top + CAP_RISE / 2), color, bevel=0.002),),
                mass=0.05,
                joint=Joint("slide", (0, 0, 1), -TRAVEL, 0.0, spring=SPRING),
            ),
        )

    @property
    def travel(self) -> float:
        """How far the cap is pressed, m, 0 at rest."""
        return -self.body.joint(1)

    @property
    def top(self) -> Array:
        """The middle of the resting cap's upper face."""
        return self.frame(0, 0, PLATE_HEIGHT + CAP_RISE)
