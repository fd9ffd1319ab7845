"""Put exactly N blocks of the named colour into the box, then withdraw the arm upward.

HIDE appendix A.1 (e). The cameras look into the box from above, and there are always four blocks
of the colour: who counts those outside knows how many are inside.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from hide_tasks.assets.block import Block
from hide_tasks.assets.block_sets import scatter_blocks
from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.container import Container
from hide_tasks.contract import Category, Failure, HiddenState, Value
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.blocks import above, carry_over, grasp, let_go, lift, rise_from
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Checks, Grid, Stage, Task

CONTAINER_AT = (0.25, 0.0)  # m
CORNER = 0.034  # m from the middle of the box, either way: a block falls into each corner
OVER_RIM = 0.03  # m from the rim to the middle of a block that is let go
CLEAR = 0.06  # m above that
RISE = 0.20  # m above that at the end
WITHDRAWN = 0.25  # m of the tip above the table
FELL = 0.1  # m under the table's top


class StackBlocksNew(Task):
    category = Category.REPETITION_COUNTING
    instructions = (
        "put {count} {color} {blocks} into the rectangular container",
        "put {count} {color} {blocks} into the rectangular container in the center",
        "place {count} of the {color} cubes inside the open box in the middle of the table",
        "drop {count} {color} {blocks} into the open-top container",
    )
    variations = Grid(count=(1, 2, 3), color=tuple(COLORS))
    looks = ("color",)
    keyframes = frozenset({6, 11, 16, 17})
    remembers = "how many blocks are in the container"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one block more than asked for",
        Failure.UNDERCOUNT: "fewer blocks than asked for",
        Failure.UNFINISHED: "the hand still holds a block",
        Failure.NOT_WITHDRAWN: "the arm stayed at the container",
        Failure.WRONG_OBJECT: "a block of another colour was taken",
        Failure.DROPPED_OBJECT: "a block fell off the table",
    }
    spoils = frozenset({Failure.OVERCOUNT})

    def build(self) -> None:
        self.container = self.layout.add(Container(), *CONTAINER_AT)
        self.targets, self.distractors = scatter_blocks(self.layout, self.variation.color)

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return {**variation, "blocks": "block" if variation["count"] == 1 else "blocks"}

    def hidden_state(self) -> HiddenState:
        return {"blocks_inside": self._inside()}

    def stage(self) -> str:
        inside = self._inside()
        return "withdraw" if inside >= self.variation.count else self._name(inside + 1)

    def expert(self) -> Iterator[Stage]:
        for number, block in enumerate(self.targets[: self.variation.count], 1):
            goal = self._over_corner(number)
            yield Stage(
                self._name(number),
                above(block),
                grasp(block),
                lift(block),
                carry_over(goal, CLEAR),
                let_go(goal),
            )
        yield Stage("withdraw", rise_from(self._over_corner(self.variation.count), RISE))

    def checks(self) -> Checks:
        return {
            "count_inside": self._inside() == self.variation.count,
            "gripper_empty": not any(map(self.robot.holds, self._blocks())),
            "arm_withdrawn": self.robot.tip_height > WITHDRAWN,
        }

    def missing(self) -> Failure:
        if self._inside() < self.variation.count:
            return Failure.UNDERCOUNT
        held = any(map(self.robot.holds, self._blocks()))
        return Failure.UNFINISHED if held else Failure.NOT_WITHDRAWN

    def violations(self) -> list[Failure]:
        over = self._inside() > self.variation.count
        wrong = any(map(self.robot.holds, self.distractors))
        fell = any(block.position[2] < TABLE_TOP - FELL for block in self._blocks())
        return (
            [Failure.OVERCOUNT] * over
            + [Failure.WRONG_OBJECT] * wrong
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        return []  # the four blocks of the colour can be counted

    def _name(self, number: int) -> str:
        """The stage of the numbered block."""
        return f"block {number}"

    def _blocks(self) -> list[Block]:
        return [*self.targets, *self.distractors]

    def _inside(self) -> int:
        """How many blocks of the colour are in the container and let go."""
        return sum(
            self.container.contains(block.position) and not self.robot.holds(block)
            for block in self.targets
        )

    def _over_corner(self, number: int) -> Array:
        """Where the numbered block is let go: a corner each."""
        x, y = ((-1, -1), (1, 1), (-1, 1))[number - 1]
        height = self.container.rim + OVER_RIM
        return point(self.container.at, x * CORNER, y * CORNER, height)
