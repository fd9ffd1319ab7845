"""Other colours for a sequence: channels change places in what is seen, and names in what is said.

A hundred demonstrations show a colour that is named among twenty only five times a task. Of most
of RLBench's colours each order of red, green and blue is again one of them; where the instruction
names a colour and the new order of it has a name, that is a demonstration of another colour.
Whatever is nearly grey (table, robot, shadows) stays.
"""

import re
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from hide_tasks.assets.colors import COLORS

Order = tuple[int, int, int]  # which channel of before is red, green, blue

SAME: Order = (0, 1, 2)
GREYISH = 0.3  # of its strongest channel: a pixel whose channels are this near is left alone
NAMES = {rgb: name for name, rgb in COLORS.items()}
WORD = re.compile(r"\b(" + "|".join(COLORS) + r")\b")


@lru_cache(maxsize=4096)
def orders(instruction: str) -> tuple[Order, ...]:
    """The orders in which every colour that is named has a name, `SAME` first.

    `SAME` alone where no colour is named.
    """
    named = [COLORS[name] for name in WORD.findall(instruction)]
    if not named:
        return (SAME,)
    return tuple(
        (r, g, b)
        for r, g, b in permutations(SAME)
        if all((one[r], one[g], one[b]) in NAMES for one in named)
    )


def draw(rng: np.random.Generator, instruction: str) -> Order:
    """One of `orders`, each as likely."""
    found = orders(instruction)
    return found[int(rng.integers(len(found)))]


def said(instruction: str, order: Order) -> str:
    """The instruction with the names of the colours in this order."""
    if order == SAME:
        return instruction
    r, g, b = order

    def renamed(match: re.Match[str]) -> str:
        before = COLORS[match[0]]
        return NAMES[before[r], before[g], before[b]]

    return WORD.sub(renamed, instruction)


def seen(colors: NDArray[np.uint8], order: Order) -> NDArray[np.uint8]:
    """Colours (p, 3) in this order, but for those that are nearly grey."""
    if order == SAME:
        return colors
    strongest = colors.max(axis=1)
    grey = strongest - colors.min(axis=1) < GREYISH * strongest
    return np.where(grey[:, None], colors, colors[:, order])
