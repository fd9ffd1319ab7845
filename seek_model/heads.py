"""What is said besides where: rotation, fingers, collisions; that a stage ends; that it is done.

f frames, v views, k features in all.
"""

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from seek_model.rotations import BINS

AXES = 3
NOISE = 2  # bins, either way, on the true angles that the later axes are told in training
STAGE_CHANNELS = 64  # of the count that the boundary head is told


class Said(NamedTuple):
    """The rest of an action, in logits."""

    rotation: Float[Tensor, "f 3 bins"]
    opening: Float[Tensor, "f 2"]
    ignore_collisions: Float[Tensor, "f 2"]


class JointHead(nn.Module):
    """RVT's: everything from one net (models.md 1.4)."""

    def __init__(self, features: int):
        super().__init__()
        self.net = nn.Sequential(
            nn.Linear(features, features // 5), nn.ReLU(),
            nn.Linear(features // 5, features // 10), nn.ReLU(),
            nn.Linear(features // 10, AXES * BINS + 4),
        )  # fmt: skip

    def forward(self, features: Float[Tensor, "f k"], true: Int[Tensor, "f 3"] | None) -> Said:
        """`true` is not read: the axes are told apart from each other."""
        rotation, opening, collisions = self.net(features).split([AXES * BINS, 2, 2], dim=-1)
        return Said(rotation.unflatten(-1, (AXES, BINS)), opening, collisions)


class ConditionalHead(nn.Module):
    """RVT-2's: x, then y knowing x, then z knowing both (models.md 1.5)."""

    def __init__(self, features: int, norm: nn.Module):
        super().__init__()
        self.norm = norm
        self.axes = nn.ModuleList(_net(features, BINS) for _ in range(AXES))
        self.rest = _net(features, 4)
        self.register_buffer("codes", _codes(features), persistent=False)

    codes: Tensor

    def forward(self, features: Float[Tensor, "f k"], true: Int[Tensor, "f 3"] | None) -> Said:
        """Angles follow each other: in training the true ones with noise, else its own."""
        told = self.norm(features)
        angles: list[Tensor] = []
        for axis, net in enumerate(self.axes):
            angles.append(net(told))
            bins = angles[axis].argmax(dim=-1) if true is None else _blurred(true[:, axis])
            told = told + self.codes[bins]
        opening, collisions = self.rest(features).split([2, 2], dim=-1)
        return Said(torch.stack(angles, dim=1), opening, collisions)


class ProgressHead(nn.Module):
    """One logit from memory-conditioned features and, if it is counted, the stage so far.

    With it SCM's counter advances (paper 4.1), and the small presets say that they are done.
    """

    def __init__(self, features: int, stages: int):
        super().__init__()
        self.stage = nn.Embedding(stages, STAGE_CHANNELS) if stages else None
        self.net = nn.Sequential(
            nn.LayerNorm(features + STAGE_CHANNELS * bool(stages)),
            nn.Linear(features + STAGE_CHANNELS * bool(stages), 256), nn.ReLU(),
            nn.Linear(256, 1),
        )  # fmt: skip

    def forward(self, features: Float[Tensor, "f k"], done: Int[Tensor, " f"]) -> Tensor:
        """(f,) logits."""
        if self.stage:
            counted = self.stage(done.clamp(max=self.stage.num_embeddings - 1))
            features = torch.cat([features, counted], dim=-1)
        logits: Tensor = self.net(features).squeeze(-1)
        return logits


def _net(features: int, out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(features, 256), nn.ReLU(), nn.Linear(256, 128), nn.ReLU(), nn.Linear(128, out)
    )


def _blurred(bins: Tensor) -> Tensor:
    noise = torch.randint_like(bins, -NOISE, NOISE + 1)
    return (bins + noise) % BINS


def _codes(channels: int) -> Float[Tensor, "bins k"]:
    """Sinusoids of a bin's number."""
    half = (channels + 1) // 2
    waves = torch.exp(-math.log(10_000.0) * torch.arange(half) / half)
    angles = torch.arange(BINS)[:, None] * waves
    return torch.stack([angles.sin(), angles.cos()], dim=-1).flatten(1)[:, :channels]
