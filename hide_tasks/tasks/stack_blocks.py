"""Stack exactly N blocks of the named colour on the patch.

HIDE appendix A.1 (b). The tower is in plain view and there are always four blocks of the colour:
the picture tells how many are stacked.
"""

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from hide_tasks.assets.block import Block
from hide_tasks.assets.block_sets import SIZE, scatter_blocks
from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.region import Region
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, carry_over, grasp, let_go, lift, rise_from
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Checks, Grid, Stage, Task

PATCH_AT = (0.25, 0.0)  # m
SIDE = 0.075  # m of the patch (RLBench stack_blocks)
GRAY = (110, 118, 110)
DROP = 0.003  # m that a block falls when it is let go
CLEAR = 0.05  # m above where it is let go (RLBench stack_blocks)
RISE = 0.10  # m
TILTED = 0.015  # m that a block's middle is off its level of the tower
FELL = 0.1  # m under the table's top


class StackBlocks(Task):
    category = Category.REPETITION_COUNTING
    instructions = (
        "stack {count} {color} blocks",
        "build a tower of {count} {color} blocks on the patch",
        "put {count} of the {color} cubes on top of each other",
    )
    variations = Grid(count=(2, 3, 4), color=tuple(COLORS))
    looks = ("color",)
    keyframes = frozenset({11, 17, 22, 23, 24})
    remembers = "how many blocks are stacked"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one block more than asked for",
        Failure.UNDERCOUNT: "fewer blocks than asked for",
        Failure.UNFINISHED: "the hand still holds a block",
        Failure.WRONG_OBJECT: "a block of another colour was taken",
        Failure.DROPPED_OBJECT: "a block fell off the table",
    }
    spoils = frozenset({Failure.OVERCOUNT})

    def build(self) -> None:
        self.patch = self.layout.add(Region(side=SIDE, color=GRAY), *PATCH_AT)
        self.targets, self.distractors = scatter_blocks(self.layout, self.variation.color)

    def hidden_state(self) -> HiddenState:
        return {"blocks_stacked": self._stacked()}

    def stage(self) -> str:
        stacked = self._stacked()
        return "done" if stacked >= self.variation.count else self._name(stacked + 1)

    def expert(self) -> Iterator[Stage]:
        for number, block in enumerate(self.targets[: self.variation.count], 1):
            goal = self._level(number) + np.array([0.0, 0.0, DROP])
            moves = (above(block), grasp(block), lift(block), carry_over(goal, CLEAR), let_go(goal))
            rise = () if number == self.variation.count else (rise_from(goal, RISE),)
            yield Stage(self._name(number), *moves, *rise)

    def checks(self) -> Checks:
        return {
            "count_stacked": self._stacked() == self.variation.count == len(self._on_patch()),
            "gripper_empty": not any(map(self.robot.holds, self._blocks())),
        }

    def missing(self) -> Failure:
        if self._stacked() < self.variation.count:
            return Failure.UNDERCOUNT
        return Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        over = len(self._on_patch()) > self.variation.count
        wrong = any(map(self.robot.holds, self.distractors))
        fell = any(block.position[2] < TABLE_TOP - FELL for block in self._blocks())
        return (
            [Failure.OVERCOUNT] * over
            + [Failure.WRONG_OBJECT] * wrong
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        return []  # the tower is seen, and the four blocks of the colour can be counted

    def _name(self, number: int) -> str:
        """The stage of the numbered block."""
        return f"block {number}"

    def _blocks(self) -> list[Block]:
        return [*self.targets, *self.distractors]

    def _stacked(self) -> int:
        """How many blocks of the colour stand on the patch, each on the one before."""
        left, tower = self._on_patch(), 0
        below: Sequence[float] = self.patch.at.tolist()
        while (block := self._next(left, tower + 1, below)) is not None:
            left = [one for one in left if one is not block]
            tower, below = tower + 1, block.position
        return tower

    def _next(self, left: list[Block], number: int, below: Sequence[float]) -> Block | None:
        """The block that stands at a level, over what is below."""
        height = self._level(number)[2]
        reach = SIDE / 2 if number == 1 else SIZE / 2
        for block in left:
            x, y, z = block.position
            over = max(abs(x - below[0]), abs(y - below[1])) <= reach
            if over and abs(z - height) <= TILTED:
                return block
        return None

    def _on_patch(self) -> list[Block]:
        """The blocks of the colour that are over the patch, at any height, and let go."""
        return [
            block for block in self.targets if not self.robot.holds(block) and self._over(block)
        ]

    def _over(self, block: Block) -> bool:
        x, y, _ = block.position
        return bool(max(abs(x - self.patch.at[0]), abs(y - self.patch.at[1])) <= SIDE / 2)

    def _level(self, number: int) -> Array:
        """The middle of the tower's numbered block."""
        return point(self.patch.at, 0, 0, (number - 0.5) * SIZE)
