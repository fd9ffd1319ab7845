"""A flat brick to be grasped across, and the white piece that it covers."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Link, box
from hide_tasks.assets.block import Block
from hide_tasks.assets.chip import THICKNESS, WHITE, Chip
from hide_tasks.assets.colors import COLORS

LENGTH, WIDTH, HEIGHT = 0.16, 0.066, 0.04  # m; the fingers open 0.08
PIECE = (0.154, 0.060)  # m: seen from across the table it is a hundred pixels


@dataclass
class Brick(Block):
    """A block that is longer than wide, x along its length; its frame is its centre."""

    mass: float = 0.125  # kg
    radius = 0.087

    def __post_init__(self) -> None:
        shape = box((LENGTH, WIDTH, HEIGHT), (0, 0, 0), COLORS[self.color], bevel=0.003)
        self.links = (Link("brick", (shape,), mass=self.mass, graspable=True, friction=1.0),)


@dataclass
class Piece(Chip):
    """A place for a white piece that a brick covers."""

    def __post_init__(self) -> None:
        slab = box((*PIECE, THICKNESS), (0, 0, THICKNESS / 2), WHITE, solid=False)
        self.links = (Link("piece", (slab,)),)
