"""What a network sees and what it should say, for e sequences of t frames each.

A frame is one decision of one episode. Positions are in the cube: the workspace scaled to
[-1, 1] along each axis (`clouds.to_cube`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True)
class _Tensors:
    def to(self, device: torch.device) -> Self:
        """The same on another device."""
        moved = {
            field.name: value.to(device, non_blocking=True)
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), Tensor)
        }
        return replace(self, **moved)


@dataclass(frozen=True)
class Frames(_Tensors):
    """What is seen. The points of all frames lie in one list, in the order of their frames."""

    points: Float[Tensor, "p 3"]  # cube
    colors: Float[Tensor, "p 3"]  # 0 to 1
    owner: Int[Tensor, " p"]  # the frame of a point: sequence * t + step
    instructions: Sequence[str]  # one a sequence
    fingers: Float[Tensor, "e t 3"]  # opening 0 to 1, then both fingers, m (0 to 0.04)
    pose: Float[Tensor, "e t 9"]  # of the tip: position in the cube, first two axes of its rotation
    decision: Int[Tensor, "e t"]  # the number of the decision in its episode
    present: Bool[Tensor, "e t"]  # False where a short sequence is padded

    @property
    def shape(self) -> tuple[int, int]:
        """Sequences and steps."""
        sequences, steps = self.present.shape
        return sequences, steps

    def between(self, first: int, last: int) -> "Frames":
        """The steps from `first` up to, not including, `last`."""
        steps = self.shape[1]
        kept = (self.owner % steps >= first) & (self.owner % steps < last)
        owner = self.owner[kept]
        return Frames(
            points=self.points[kept],
            colors=self.colors[kept],
            owner=owner // steps * (last - first) + owner % steps - first,
            instructions=self.instructions,
            fingers=self.fingers[:, first:last],
            pose=self.pose[:, first:last],
            decision=self.decision[:, first:last],
            present=self.present[:, first:last],
        )


@dataclass(frozen=True)
class Targets(_Tensors):
    """What the demonstration did. Where `supervised` is False the rest only fills memory."""

    position: Float[Tensor, "e t 3"]  # cube
    rotation: Int[Tensor, "e t 3"]  # bins of 5 degrees, 0 to 71
    opening: Int[Tensor, "e t"]  # 1: open after the keyframe
    ignore_collisions: Int[Tensor, "e t"]
    stage: Int[Tensor, "e t"]  # how many stages are done
    boundary: Float[Tensor, "e t"]  # 1: a stage ends with this keyframe
    stop: Float[Tensor, "e t"]  # 1: the last keyframe
    evidence: Int[Tensor, "e t"]  # the decision that an oracle would look back at; -1: none
    supervised: Bool[Tensor, "e t"]

    def between(self, first: int, last: int) -> "Targets":
        """The steps from `first` up to `last`."""
        return replace(
            self, **{field.name: getattr(self, field.name)[:, first:last] for field in fields(self)}
        )

    def at(self, sequence: Int[Tensor, " f"], step: Int[Tensor, " f"]) -> "Targets":
        """Single frames; the fields lose their second dimension."""
        return replace(
            self,
            **{field.name: getattr(self, field.name)[sequence, step] for field in fields(self)},
        )
