"""An open box that stands on the table."""

from collections.abc import Sequence
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, box
from hide_tasks.assets.colors import RGB

WALL = 0.008  # m
FLOOR = 0.004  # m


@dataclass
class Container(Asset):
    """A square box without a lid."""

    inside: float = 0.14  # m, either way
    depth: float = 0.09  # m: more than one layer of blocks
    color: RGB = (150, 110, 75)

    def __post_init__(self) -> None:
        long, short, height = self.inside + 2 * WALL, self.inside, self.rim
        off = (self.inside + WALL) / 2
        walls = (
            *(box((long, WALL, height), (0, y, height / 2), self.color) for y in (-off, off)),
            *(box((WALL, short, height), (x, 0, height / 2), self.color) for x in (-off, off)),
        )
        floor = box((self.inside, self.inside, FLOOR), (0, 0, FLOOR / 2), self.color)
        self.links = (Link("box", (*walls, floor)),)

    @property
    def rim(self) -> float:
        """Its upper edge above the table, m."""
        return self.depth + FLOOR

    def contains(self, position: Sequence[float]) -> bool:
        """True when a point of the world is within the walls and under the rim."""
        x, y, z = (float(p - q) for p, q in zip(position, self.at[:3], strict=True))
        return max(abs(x), abs(y)) <= self.inside / 2 and 0.0 <= z <= self.rim
