"""The colours that an instruction names, shown to the network beside what it sees.

A text encoder that was trained on pictures knows what maroon looks like; a reader that is trained
on a hundred demonstrations a task sees each name five times. So the names' RGB values (RLBench's
table) come with the pixels: how far each is from what is named. What to make of it is learnt.
"""

from collections.abc import Sequence
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from hide_tasks.assets.colors import COLORS
from seek_model.recolor import WORD

TOLD = 4  # red, green, blue, and whether there is such a colour


def channels(most: int, layers: int) -> int:
    """How many `compared` adds to images of so many layers."""
    return most * (3 * layers + 1)


def named(instructions: Sequence[str], most: int) -> Float[Tensor, "e {most} 4"]:
    """The first colours of each instruction, 0 to 1, and 1 where there is one; else zeros."""
    return torch.tensor([_first(text, most) for text in instructions])


@lru_cache(maxsize=4096)
def _first(instruction: str, most: int) -> list[list[float]]:
    found = WORD.findall(instruction.lower())[:most]
    told = [[*(value / 255 for value in COLORS[name]), 1.0] for name in found]
    return told + [[0.0] * TOLD] * (most - len(found))


def compared(
    images: Float[Tensor, "f v c s s"], told: Float[Tensor, "f n 4"], red: Sequence[int]
) -> Tensor:
    """The images with more channels: what each pixel differs by from each colour; which there are.

    Args:
        images: of frames.
        told: what each frame's instruction names.
        red: the channels where the colours of a layer begin.
    """
    size = images.shape[-1]
    added = []
    for one in told.unbind(dim=1):
        color, there = one[:, None, :3, None, None], one[:, None, 3:, None, None]
        added += [(images[:, :, at : at + 3] - color) * there for at in red]
        added.append(there.expand(-1, images.shape[1], -1, size, size))
    return torch.cat([images, *added], dim=2)
