"""The small trunk: a convolutional pyramid that is told the instruction at every level.

From scratch and on few samples this localises what is meant within thousands of frames, where a
patch transformer does not (measured: models.md 4.3). Above the pyramid the cells of all views look
at each other and at the words.
"""

from itertools import pairwise

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.attention import attend
from seek_model.config import ConvFilm, Views
from seek_model.trunk import Decoded, Seen, Words
from seek_model.views import CHANNELS


class Level(nn.Module):
    """Halves an image's sides and tells it the instruction: a scale and a shift per channel."""

    def __init__(self, channels: int, width: int, told: int):
        super().__init__()
        self.halve = nn.Conv2d(channels, width, 3, stride=2, padding=1)
        self.first, self.second = nn.GroupNorm(8, width), nn.GroupNorm(8, width)
        self.conv = nn.Conv2d(width, width, 3, padding=1)
        self.film = nn.Linear(told, 2 * width)

    def forward(self, image: Float[Tensor, "n c s s"], told: Float[Tensor, "n k"]) -> Tensor:
        """(n, width, s/2, s/2)."""
        scale, shift = rearrange(self.film(told), "n (two c) -> two n c 1 1", two=2)
        x = nn.functional.gelu(self.first(self.halve(image)) * (1 + scale) + shift)
        return x + nn.functional.gelu(self.second(self.conv(x)))


class Pyramid(nn.Module):
    """Images to levels of features, the finest first."""

    def __init__(self, config: ConvFilm, told: int, pixels: int):
        super().__init__()
        channels = (pixels, *config.widths)
        self.levels = nn.ModuleList(
            Level(before, width, told) for before, width in pairwise(channels)
        )

    def forward(self, images: Tensor, told: Tensor) -> list[Tensor]:
        found = []
        for level in self.levels:
            images = level(images, told)
            found.append(images)
        return found


class Layer(nn.Module):
    """Attention among the cells of all views and the words, then a feed-forward net."""

    def __init__(self, channels: int, heads: int):
        super().__init__()
        self.heads = heads
        self.norm, self.norm_after = nn.LayerNorm(channels), nn.LayerNorm(channels)
        self.qkv, self.out = nn.Linear(channels, 3 * channels), nn.Linear(channels, channels)
        self.feedforward = nn.Sequential(
            nn.Linear(channels, 4 * channels), nn.GELU(), nn.Linear(4 * channels, channels)
        )

    def forward(self, tokens: Float[Tensor, "f n d"], mask: Tensor) -> Tensor:
        qkv = rearrange(
            self.qkv(self.norm(tokens)), "f n (three g d) -> three f g n d", three=3, g=self.heads
        )
        looked = attend(qkv[0], qkv[1], qkv[2], mask=mask)
        tokens = tokens + self.out(rearrange(looked, "f g n d -> f n (g d)"))
        after: Tensor = tokens + self.feedforward(self.norm_after(tokens))
        return after


class ConvFilmTrunk(nn.Module):
    """A trunk (`trunk.Trunk`); `pixels` is the number of an image's channels."""

    def __init__(
        self, config: ConvFilm, views: Views, words: int, fingers: int, pixels: int = CHANNELS
    ):
        super().__init__()
        self.channels, self.cells = config.channels, views.size // config.stride
        self.skip_channels = config.widths[:-1]
        self.backbone_channels = config.widths[-1]
        self.encoder = Pyramid(config, words + fingers, pixels)
        self.lift = nn.Conv2d(config.widths[-1], config.channels, 1)
        self.words = nn.Linear(words, config.channels)
        self.position = nn.Parameter(
            0.02 * torch.randn(views.count, config.channels, self.cells, self.cells)
        )
        self.layers = nn.ModuleList(
            Layer(config.channels, config.heads) for _ in range(config.depth)
        )

    def forward(
        self, images: Float[Tensor, "f v c s s"], words: Words, fingers: Float[Tensor, "f p"]
    ) -> Seen:
        frames, views = images.shape[:2]
        told = torch.cat([words.pooled, fingers], dim=-1).repeat_interleave(views, dim=0)
        *skips, top = self.encoder(images.flatten(0, 1), told)
        cells = rearrange(self.lift(top), "(f v) d h w -> f v d h w", v=views) + self.position
        tokens = torch.cat(
            [self.words(words.tokens), rearrange(cells, "f v d h w -> f (v h w) d")], dim=1
        )
        seen = torch.ones(frames, tokens.shape[1] - words.mask.shape[1], dtype=torch.bool)
        mask = torch.cat([words.mask, seen.to(words.mask.device)], dim=1)[:, None, None]
        for layer in self.layers:
            tokens = layer(tokens, mask)
        features = rearrange(
            tokens[:, words.mask.shape[1] :],
            "f (v h w) d -> f v d h w", v=views, h=self.cells, w=self.cells,
        )  # fmt: skip
        pooled = rearrange(top.mean(dim=(2, 3)), "(f v) k -> f v k", v=views)
        return Seen(features, tuple(skips), pooled)


class PyramidDecoder(nn.Module):
    """Features back up to heat maps, with the pyramid's finer levels for precision."""

    def __init__(self, channels: int, skip_channels: tuple[int, ...], size: int):
        super().__init__()
        self.size = size
        widths = (channels, *reversed(skip_channels))
        self.across = nn.ModuleList(
            nn.Conv2d(before, width, 1) for before, width in pairwise(widths)
        )
        self.after = nn.ModuleList(
            nn.Sequential(nn.Conv2d(w, w, 3, padding=1), nn.GroupNorm(8, w), nn.GELU())
            for w in widths[1:]
        )
        self.out = nn.Conv2d(widths[-1], 1, 3, padding=1)

    def forward(self, features: Float[Tensor, "f v d h w"], skips: tuple[Tensor, ...]) -> Decoded:
        x = features.flatten(0, 1)
        for across, after, skip in zip(self.across, self.after, reversed(skips), strict=True):
            x = after(_doubled(across(x)) + skip)  # a 1x1 convolution need not see cells twice
        logits = nn.functional.interpolate(
            self.out(x), size=(self.size, self.size), mode="bilinear", align_corners=False
        )
        return Decoded(rearrange(logits, "(f v) 1 h w -> f v h w", v=features.shape[1]))


def _doubled(x: Tensor) -> Tensor:
    return nn.functional.interpolate(x, scale_factor=2, mode="nearest")
