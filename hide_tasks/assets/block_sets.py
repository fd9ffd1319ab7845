"""Blocks of the named colour among as many of another, loose on either side of the middle."""

import math

from hide_tasks.assets.block import Block
from hide_tasks.assets.colors import COLORS
from hide_tasks.layout import Area, Layout

SIZE, MASS = 0.05, 0.125  # m, kg; RLBench stack_blocks
COUNT = 4  # of each colour
# The hand, 0.21 m wide, reaches every block beside what stands in the middle.
SIDES = (Area(x=(0.07, 0.42), y=(0.195, 0.37)), Area(x=(0.07, 0.42), y=(-0.37, -0.195)))
GAP = 0.02  # m between two blocks' circles: 0.12 from middle to middle, room for the fingers
DISTINCT = 150.0  # of 255, between two colours that nobody confuses at 128 pixels


def scatter_blocks(
    layout: Layout, color: str, *, count: int = COUNT, others: int = COUNT
) -> tuple[list[Block], list[Block]]:
    """The blocks of a colour and those of another; who lies on which side is chance."""
    targets = [Block(color, SIZE, MASS) for _ in range(count)]
    other = other_than(color, [list(COLORS)[i] for i in layout.rng.permutation(len(COLORS))])
    distractors = [Block(other, SIZE, MASS) for _ in range(others)]
    mixed = [[*targets, *distractors][i] for i in layout.rng.permutation(count + others)]
    half = (count + others) // 2
    for side, blocks in zip(SIDES, (mixed[:half], mixed[half:]), strict=True):
        for block in layout.scatter(blocks, side, gap=GAP, turn=math.pi / 4):
            block.at[2] += SIZE / 2
    return targets, distractors


def other_than(color: str, order: list[str]) -> str:
    """The first that is clearly another colour."""
    return next(name for name in order if math.dist(COLORS[name], COLORS[color]) > DISTINCT)
