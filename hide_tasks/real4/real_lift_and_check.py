"""Lift the blocks one by one until the white piece is found, then take its block away.

HIDE appendix, real-world task (d), seen by one external camera. The paper counts three variations,
the places of the hidden piece, and keyframes for four (6, 11, 16 or 21); it does not say how many
blocks there are. Here three stand on the desk, so a script has 6, 11 or 16 keyframes. The blocks
are flat and long and the piece is nearly as large: from across the desk it is still seen. As in
`lift_and_check` the found piece's block goes to a marked region: the paper's "required final
action" has no name.
"""

from typing import ClassVar

from hide_tasks.assets.block import Block
from hide_tasks.assets.brick import HEIGHT, Brick, Piece
from hide_tasks.contract import Failure
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.poses import yaw_of
from hide_tasks.task import Grid
from hide_tasks.tasks.lift_and_check import PLACES, LiftAndCheck

COLORS = ("red", "green", "blue", "yellow", "orange", "purple")
AREA = Area(x=(0.28, 0.40), y=(-0.16, 0.32))  # towards the camera
GAP = 0.002  # m between two bricks' circles
TURN = 0.3  # rad, at most, either way


class RealLiftAndCheck(LiftAndCheck):
    instructions = (
        "lift the blocks and look for the white piece",
        "lift the blocks one by one and find the white piece underneath",
    )
    variations = Grid(chip_under=PLACES[:3])
    histories = Grid(color=COLORS)
    keyframes = frozenset({6, 11, 16})
    cameras: ClassVar = ("front",)
    places: ClassVar = PLACES[:3]
    tall: ClassVar = HEIGHT
    failures: ClassVar = {
        **LiftAndCheck.failures,
        Failure.UNFINISHED: "the white piece was not found",
    }

    def _scattered(self) -> list[Block]:
        bricks: list[Block] = [Brick(self.variation.color) for _ in self.places]
        return self.layout.scatter(bricks, AREA, gap=GAP, turn=TURN)

    def _hide(self, block: Block, *, there: bool) -> None:
        x, y = block.at[:2]
        self.layout.add(Piece(there), x, y, z=TABLE_TOP, yaw=yaw_of(block.at))
