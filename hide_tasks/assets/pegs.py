"""Three square pegs on a board, and the square rings that go over them."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, box, shade
from hide_tasks.assets.colors import COLORS
from hide_tasks.poses import Array, quaternion

PEGS = ("left", "middle", "right")  # as the robot sees them

# Metres. The board is RLBench's; its pegs are shorter, so that the palm clears them when the
# fingers hold a ring from outside.
BOARD = (0.10, 0.40, 0.02)
PITCH = 0.125  # from one peg to the next
PEG = 0.025  # side
PEG_HEIGHT = 0.045
OUTER = 0.06  # side of a ring
BAR = 0.0145  # of a ring: 3 mm of play on every side of a peg
RING_HEIGHT = 0.024
GAP = 0.001  # under a ring that sits
WOOD = (122, 86, 58)
PALE = (240, 236, 226)


@dataclass
class PegBoard(Asset):
    """A fixed board. Its frame is the middle of its underside, y along the row to the left."""

    radius = 0.21

    def __post_init__(self) -> None:
        length, width, height = BOARD
        middle = height + PEG_HEIGHT / 2
        pegs = (
            box((PEG, PEG, PEG_HEIGHT), (0, self._aside(peg), middle), PALE, bevel=0.002)
            for peg in PEGS
        )
        board = box((length, width, height), (0, 0, height / 2), WOOD, bevel=0.003)
        self.links = (Link("board", (board, *pegs)),)

    def place_on(self, peg: str) -> Array:
        """Where a ring sits on a peg, pose (7,)."""
        return self.frame(0, self._aside(peg), BOARD[2] + GAP + RING_HEIGHT / 2, quaternion())

    @staticmethod
    def _aside(peg: str) -> float:
        return (1 - PEGS.index(peg)) * PITCH


@dataclass
class SquareRing(Asset):
    """A loose ring of four bars; its frame is its centre."""

    color: str
    mass: float = 0.08  # kg

    def __post_init__(self) -> None:
        color = COLORS[self.color]
        aside = (OUTER - BAR) / 2
        bars = (
            *(
                box((OUTER, BAR, RING_HEIGHT), (0, side * aside, 0), color, bevel=0.002)
                for side in (-1, 1)
            ),
            *(
                box((BAR, OUTER - 2 * BAR, RING_HEIGHT), (side * aside, 0, 0), shade(color, 0.9))
                for side in (-1, 1)
            ),
        )
        self.links = (Link("ring", bars, mass=self.mass, graspable=True, friction=1.0),)
