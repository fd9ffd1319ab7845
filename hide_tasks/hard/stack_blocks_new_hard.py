"""Post exactly N blocks of the named colour into the closed container, then withdraw the arm.

`stack_blocks_new` without its two leaks: the container has a flap, and some blocks are in it from
before. What lies outside and the container look the same whether a block was put in just now or
long ago.
"""

from typing import ClassVar

from hide_tasks.assets.block_sets import SIZE, scatter_blocks
from hide_tasks.assets.posting import PostingBox
from hide_tasks.contract import Failure
from hide_tasks.hard import TOLD_COLORS
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Grid, Moment
from hide_tasks.tasks.stack_blocks_new import CONTAINER_AT, OVER_RIM, StackBlocksNew

COUNTS, EXTRAS = (2, 3), (0, 1, 2)  # one block needs no memory: the hand is at the container
MOST = COUNTS[-1] + EXTRAS[-1]  # blocks of the colour, those inside from the start among them
OTHERS = 2
MOVES = 5  # keyframes of a block


class StackBlocksNewHard(StackBlocksNew):
    instructions = (
        "put {count} {color} {blocks} into the closed rectangular container",
        "put {count} {color} {blocks} into the closed container in the center",
        "post {count} of the {color} cubes through the flap of the box in the middle of the table",
        "drop {count} {color} {blocks} through the opening of the closed container",
    )
    variations = Grid(count=COUNTS, color=TOLD_COLORS)
    histories = Grid(extra=EXTRAS)
    keyframes = frozenset({11, 16})
    remembers = "how many blocks were put into the container"
    failures: ClassVar = {
        **StackBlocksNew.failures,
        Failure.OVERCOUNT: "one block more than asked for; it is seen no more",
    }

    def build(self) -> None:
        layout, color = self.layout, self.variation.color
        blocks, self.distractors = scatter_blocks(layout, color, count=MOST, others=OTHERS)
        loose = self.variation.count + self.variation.extra
        self.targets = blocks[:loose][::-1]  # the last is taken first: then the twin's are left
        layout.hold([*self.targets, *self.distractors])
        box = PostingBox(things=[*blocks, *self.distractors], size=SIZE)
        self.container = layout.add(box, *CONTAINER_AT)
        for number in range(loose, MOST):
            box.store(number)

    def aliases(self) -> list[Alias]:
        return [self._alias(extra) for extra in EXTRAS[1:]]

    def _alias(self, extra: int) -> Alias:
        """All are in, or one is lacking where one more lay outside at the start."""
        done = self.variation.count
        return Alias(
            Moment(MOVES * done, {"extra": extra}),
            Moment(MOVES * (done - 1), {"extra": extra - 1}),
            f"at the container, all are in or one is lacking; {extra} lie outside",
        )

    def _name(self, number: int) -> str:
        """A stage is told by what is to be seen then: how many lay about, and which this is."""
        return f"block {number} of {len(self.targets)}"

    def _over_corner(self, number: int) -> Array:
        """Where every block is let go: over the flap."""
        return point(self.container.at, 0.0, 0.0, self.container.rim + OVER_RIM)
