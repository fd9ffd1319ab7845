"""The decoders of RVT, RVT-2 and SAM2Act: features of cells to one heat map a view.

n images (frames times views), c channels, h = w cells a side, s pixels a side.
"""

from itertools import pairwise

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.trunk import Decoded

LEAK = 0.02
NEIGHBOURS = 9  # cells that a finer cell is a mean of
MASK_SCALE = 0.1  # of the logits of their weights: soft at first (RVT-2)


def resized(x: Float[Tensor, "n c h w"], side: int) -> Float[Tensor, "n c side side"]:
    """Interpolated between cells' centres; itself where it has that side already."""
    if x.shape[-1] == side:
        return x
    return nn.functional.interpolate(x, (side, side), mode="bilinear", align_corners=False)


class ConvDecoder(nn.Module):
    """RVT's (models.md 1.4): bilinear between two wide convolutions; the mixed pixels join in.

    Its `local` features are what RVT's head gathers where the heat map is high.
    """

    def __init__(self, channels: int, size: int, cells: int, skip_channels: tuple[int, ...] = ()):
        super().__init__()
        self.size, self.local_channels = size, channels // 2
        self.joining = min(len(skip_channels), 1)  # only the finest
        inner, patch = self.local_channels, size // cells
        self.before = _smooth(channels, inner, patch)
        self.after = _smooth(inner, inner, patch)
        self.local = _smooth(inner + sum(skip_channels[: self.joining]), inner, 3)
        self.out = nn.Conv2d(inner, 1, 3, padding=1, padding_mode="replicate")

    def forward(self, features: Float[Tensor, "f v d h w"], skips: tuple[Tensor, ...]) -> Decoded:
        x = self.after(resized(self.before(features.flatten(0, 1)), self.size))
        joining = (resized(skip, self.size) for skip in skips[: self.joining])
        local = self.local(torch.cat([x, *joining], dim=1))
        views = features.shape[1]
        return Decoded(
            _maps(self.out(local), views),
            rearrange(local, "(f v) u h w -> f v u h w", v=views),
        )


def _smooth(channels: int, width: int, kernel: int) -> nn.Sequential:
    conv = nn.Conv2d(channels, width, kernel, padding="same", padding_mode="replicate")
    return nn.Sequential(conv, nn.LeakyReLU(LEAK))


class ConvexUp(nn.Module):
    """Upsampling by learned means: a finer cell is a convex sum of nine (Teed and Deng 2020)."""

    def __init__(self, channels: int, width: int, ratio: int):
        super().__init__()
        self.ratio, inner = ratio, 2 * channels
        self.low = nn.Sequential(
            nn.Conv2d(channels, inner, 3, padding=1), nn.ReLU(),
            nn.Conv2d(inner, inner, 3, padding=1), nn.ReLU(),
            nn.Conv2d(inner, width, 3, padding=1),
        )  # fmt: skip
        self.mask = nn.Sequential(
            nn.Conv2d(channels, inner, 3, padding=1), nn.ReLU(),
            nn.Conv2d(inner, NEIGHBOURS * ratio**2, 1),
        )  # fmt: skip

    def forward(self, x: Float[Tensor, "n c h w"]) -> Float[Tensor, "n width s s"]:
        """`ratio` times as many cells a side."""
        h, w = x.shape[2:]
        mask = rearrange(MASK_SCALE * self.mask(x), "n (k r) h w -> n k r h w", k=NEIGHBOURS)
        near = nn.functional.unfold(self.low(x), 3, padding=1)
        near = rearrange(near, "n (c k) (h w) -> n c k h w", k=NEIGHBOURS, h=h, w=w)
        finer = torch.einsum("nkrhw, nckhw -> ncrhw", mask.softmax(dim=1), near)
        return rearrange(finer, "n c (p q) h w -> n c (h p) (w q)", p=self.ratio)


class ConvexDecoder(nn.Module):
    """RVT-2's (models.md 1.5): one step from cells to pixels."""

    def __init__(self, channels: int, size: int, cells: int):
        super().__init__()
        self.up = ConvexUp(channels, 1, size // cells)

    def forward(self, features: Float[Tensor, "f v d h w"], skips: tuple[Tensor, ...]) -> Decoded:
        return Decoded(_maps(self.up(features.flatten(0, 1)), features.shape[1]))


class ImageNorm(nn.LayerNorm):
    """Layer normalisation over the channels of every pixel."""

    def forward(self, input: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
        normed = super().forward(rearrange(input, "n c h w -> n h w c"))
        return rearrange(normed, "n h w c -> n c h w")


class MultiResolutionDecoder(nn.Module):
    """SAM2Act's (models.md 1.11): three convex steps that take in the encoder's finer levels.

    Of other sizes than the paper's the levels are resized to where they join.
    """

    def __init__(self, channels: int, skip_channels: tuple[int, ...], size: int, cells: int):
        super().__init__()
        self.size = size
        widths = (channels, *reversed(skip_channels))
        self.ups = nn.ModuleList(ConvexUp(before, width, 2) for before, width in pairwise(widths))
        self.norms = nn.ModuleList(ImageNorm(width, eps=1e-6) for width in widths[1:])
        self.last = ConvexUp(widths[-1], 1, 2)

    def forward(self, features: Float[Tensor, "f v d h w"], skips: tuple[Tensor, ...]) -> Decoded:
        # In full precision, as the ancestors': rounding would show between the finest cells.
        with torch.autocast(features.device.type, enabled=False):
            x = features.flatten(0, 1).float()
            for up, norm, skip in zip(self.ups, self.norms, reversed(skips), strict=True):
                x = up(x)
                x = nn.functional.leaky_relu(norm(x + resized(skip.float(), x.shape[-1])), LEAK)
            maps = self.last(resized(x, (self.size + 1) // 2))
        return Decoded(_maps(maps[..., : self.size, : self.size], features.shape[1]))


def _maps(x: Float[Tensor, "n 1 s s"], views: int) -> Float[Tensor, "f v s s"]:
    return rearrange(x, "(f v) 1 h w -> f v h w", v=views)
