"""Stack exactly N blocks of the named colour on the one in the dispenser, then withdraw the arm.

`stack_blocks` without its two leaks: the tower sinks into the table, so that its top looks the
same at any height, and there are more blocks of the colour than asked for, some of them in the
dispenser from before.
"""

from collections.abc import Iterator
from typing import ClassVar

from hide_tasks.assets.block import Block
from hide_tasks.assets.block_sets import MASS, SIZE, scatter_blocks
from hide_tasks.assets.dispenser import BlockDispenser
from hide_tasks.contract import Failure
from hide_tasks.hard import TOLD_COLORS
from hide_tasks.motion.blocks import rise_from
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Checks, Grid, Moment, Stage
from hide_tasks.tasks.stack_blocks import PATCH_AT, StackBlocks

COUNTS, EXTRAS = (2, 3, 4), (0, 1, 2, 3)
MOST = COUNTS[-1] + EXTRAS[-1]  # blocks of the colour beside the one in the dispenser
OTHERS = 1
LEVEL = 0.085  # m of the top block's middle above the table
MOVES = 6  # keyframes of a block; the last one's rise is the withdrawal
UP = 0.20  # m that the arm withdraws
WITHDRAWN = 0.28  # m of the tip above the table


class StackBlocksHard(StackBlocks):
    instructions = (
        "stack {count} {color} blocks on the block in the dispenser",
        "put {count} more {color} blocks on top of the one in the dispenser, one after the other",
        "place {count} of the {color} cubes on the dispenser's top cube",
    )
    variations = Grid(count=COUNTS, color=TOLD_COLORS)
    histories = Grid(extra=EXTRAS)
    keyframes = frozenset({12, 18, 24})
    failures: ClassVar = {
        **StackBlocks.failures,
        Failure.NOT_WITHDRAWN: "the arm stayed at the dispenser",
    }

    def build(self) -> None:
        count, color = self.variation.count, self.variation.color
        blocks, self.distractors = scatter_blocks(self.layout, color, count=MOST, others=OTHERS)
        self.blocks = [*blocks, self.layout.add(Block(color, SIZE, MASS), *PATCH_AT)]
        dispenser = BlockDispenser(self.blocks, LEVEL, SIZE, size=SIZE)
        self.dispenser = self.layout.add(dispenser, *PATCH_AT)
        loose = count + self.variation.extra
        for number in range(MOST, loose - 1, -1):
            self.dispenser.store(number)
        self.targets = blocks[:loose][::-1]  # the last is taken first: then the twin's are left
        self.layout.hold([*self.targets, *self.distractors])

    def stage(self) -> str:
        stacked = self._stacked()
        return "withdraw" if stacked >= self.variation.count else self._name(stacked + 1)

    def expert(self) -> Iterator[Stage]:
        yield from super().expert()
        yield Stage("withdraw", rise_from(self._level(0), UP))

    def checks(self) -> Checks:
        return {**super().checks(), "arm_withdrawn": self.robot.tip_height > WITHDRAWN}

    def missing(self) -> Failure:
        missing = super().missing()
        done = missing is Failure.UNFINISHED and self.checks()["gripper_empty"]
        return Failure.NOT_WITHDRAWN if done else missing

    def aliases(self) -> list[Alias]:
        return [self._alias(extra) for extra in EXTRAS[1:]]

    def _alias(self, extra: int) -> Alias:
        """All are stacked, or one is lacking where one more lay about at the start."""
        done = self.variation.count
        return Alias(
            Moment(MOVES * done - 1, {"extra": extra}),
            Moment(MOVES * (done - 1) - 1, {"extra": extra - 1}),
            f"at the dispenser, all are stacked or one is lacking; {extra} lie about",
        )

    def _name(self, number: int) -> str:
        """A stage is told by what is to be seen then: how many lay about, and which this is."""
        return f"block {number} of {len(self.targets)}"

    def _blocks(self) -> list[Block]:
        """Those that are not in the dispenser."""
        every = [*self.blocks, *self.distractors]
        return [block for block in every if not self.dispenser.holds(block)]

    def _stacked(self) -> int:
        return len(self._on_patch())

    def _on_patch(self) -> list[Block]:
        """The blocks that were put on the dispenser."""
        return [block for block in self.targets if self.dispenser.holds(block)]

    def _level(self, number: int) -> Array:
        """Where every block is put: on the top one."""
        return point(self.dispenser.at, 0, 0, LEVEL + SIZE)
