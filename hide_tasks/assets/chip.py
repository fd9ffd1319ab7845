"""A flat white chip that lies under something: seen once it is uncovered, never felt."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, cylinder
from hide_tasks.poses import Array

RADIUS = 0.020  # m; a block of 0.05 covers it
THICKNESS = 0.004  # m
WHITE = (250, 250, 250)


@dataclass
class Chip(Asset):
    """A place for a chip; it lies there, or it does not.

    It is not solid: what stands on it does not tilt, and so does not betray it.
    """

    there: bool = True

    def __post_init__(self) -> None:
        disc = cylinder(RADIUS, THICKNESS, (0, 0, THICKNESS / 2), WHITE, solid=False)
        self.links = (Link("chip", (disc,)),)

    def drawn(self, link: int) -> Array | None:
        return self.pose(link) if self.there else None

    def describe(self) -> dict[str, object]:
        return {**super().describe(), "there": self.there}
