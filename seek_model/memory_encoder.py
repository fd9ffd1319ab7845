"""What is stored of an interaction: m_t, from what was seen and where the policy went (paper 4.2).

n frames and views together, d channels of features, c of an entry, h = w cells, s pixels.
"""

import math
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.upsampling import ImageNorm

PROPRIOCEPTION = 10  # position, two axes of the rotation, opening


class ConvNeXtBlock(nn.Module):
    """A wide convolution per channel and a net across channels, scaled near zero at first."""

    def __init__(self, channels: int):
        super().__init__()
        self.within = nn.Conv2d(channels, channels, 7, padding=3, groups=channels)
        self.norm = ImageNorm(channels)
        self.across = nn.Sequential(
            nn.Conv2d(channels, 4 * channels, 1), nn.GELU(), nn.Conv2d(4 * channels, channels, 1)
        )
        self.scale = nn.Parameter(torch.full((channels, 1, 1), 1e-6))

    def forward(self, image: Float[Tensor, "n c h w"]) -> Tensor:
        changed: Tensor = image + self.scale * self.across(self.norm(self.within(image)))
        return changed


class HeatmapReader(nn.Module):
    """A heat map as features of the cells' size."""

    def __init__(self, size: int, cells: int, channels: int):
        super().__init__()
        halvings = max(math.ceil(math.log2(size / cells)), 1)
        self.size = cells * 2**halvings
        widths = [4**i for i in range(halvings + 1)]
        layers: list[nn.Module] = []
        for before, width in pairwise(widths):
            conv = nn.Conv2d(before, width, 3, stride=2, padding=1)
            layers += [conv, ImageNorm(width), nn.GELU()]
        self.net = nn.Sequential(*layers, nn.Conv2d(widths[-1], channels, 1))

    def forward(self, heatmap: Float[Tensor, "n s s"]) -> Float[Tensor, "n d h w"]:
        resized = nn.functional.interpolate(
            heatmap[:, None], size=(self.size, self.size), mode="bilinear", align_corners=False
        )
        read: Tensor = self.net(resized)
        return read


class MemoryEncoder(nn.Module):
    """Features and heat map to an entry.

    SAM 2's memory encoder: both are added, mixed and narrowed. The heat map is scaled by its
    own maximum to [-10, 10], because the offset of softmax logits means nothing (models.md D5).
    """

    def __init__(
        self, features: int, channels: int, *, size: int, cells: int, heatmap: str, content: str
    ):
        super().__init__()
        self.heatmap = HeatmapReader(size, cells, features)
        self.features = nn.Conv2d(features, features, 1)
        self.mix = nn.Sequential(ConvNeXtBlock(features), ConvNeXtBlock(features))
        self.narrow = nn.Conv2d(features, channels, 1)
        self.scaled = {"max": _by_maximum, "sigmoid": _by_sigmoid}[heatmap]
        self.proprioception = (
            nn.Sequential(nn.Linear(PROPRIOCEPTION, features), nn.GELU(),
                          nn.Linear(features, features))
            if content == "proprioception"
            else None
        )  # fmt: skip

    def forward(
        self,
        features: Float[Tensor, "f v d h w"],
        logits: Float[Tensor, "f v s s"],
        body: Float[Tensor, "f 10"],
    ) -> Float[Tensor, "f v n c"]:
        """Entries of frames.

        Args:
            features: before memory was read into them.
            logits: of the heat maps that the policy predicted.
            body: pose and opening, for the ablation that stores these alone (models.md A13).
        """
        maps = self.scaled(logits.flatten(0, 1).float())
        if self.proprioception:
            tiled = self.proprioception(body)[:, None, :, None, None]
            features, maps = tiled.expand_as(features), torch.zeros_like(maps)
        mixed = self.features(features.flatten(0, 1)) + self.heatmap(maps)
        entry = self.narrow(self.mix(mixed))
        tokens: Tensor = entry.flatten(2).transpose(1, 2).unflatten(0, features.shape[:2])
        return tokens


def _by_maximum(logits: Float[Tensor, "n s s"]) -> Tensor:
    heat = (logits - logits.amax(dim=(1, 2), keepdim=True)).exp()  # softmax over its maximum
    return 20 * heat - 10


def _by_sigmoid(logits: Float[Tensor, "n s s"]) -> Tensor:
    return 20 * logits.sigmoid() - 10
