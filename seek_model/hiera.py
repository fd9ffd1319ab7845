"""SAM 2.1's image encoder: Hiera and the neck that brings its stages to one width.

Parts carry the names of Meta's published parameters, so that its files load (`sam2_weights`).
b images, h and w cells, c channels. Sources: Ryali et al. 2023 (Hiera), Bolya et al. 2023 (the
position code in two parts), Ravi et al. 2024 (SAM 2) and its published configurations.
"""

from collections import OrderedDict
from typing import NamedTuple

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.attention import attend

EPSILON = 1e-6  # of every layer normalisation
STRIDE = 4  # pixels a side of a cell of the first stage; it doubles with every stage
MULTIPLE = 32  # an image's side is a multiple of it: 4 pixels a cell, 8 cells a window


class Variant(NamedTuple):
    """The sizes of an encoder."""

    width: int  # channels of the first stage; they double with every stage
    heads: int  # of the first stage; they double as well
    stages: tuple[int, int, int, int]  # blocks
    everywhere: tuple[int, ...]  # blocks that look at the whole image
    windows: tuple[int, int, int, int] = (8, 4, 14, 7)  # cells a side that the others look at
    background: int = 7  # cells a side of the coarse part of the position code
    neck: int = 256  # channels of every level of the neck


VARIANTS = {
    "tiny": Variant(96, 1, (1, 2, 7, 2), (5, 7, 9)),
    "small": Variant(96, 1, (1, 2, 11, 2), (7, 10, 13)),
    "base_plus": Variant(112, 2, (2, 3, 16, 3), (12, 16, 20), background=14),
    "large": Variant(144, 2, (2, 6, 36, 4), (23, 33, 43), (8, 4, 16, 8)),
    "toy": Variant(16, 1, (1, 1, 1, 1), (2,), neck=32),  # for tests; nobody publishes weights
}


class Levels(NamedTuple):
    """What the neck gives, the finest first; the coarsest stage only feeds the one before."""

    fine: Float[Tensor, "b c h1 w1"]  # a cell is 4 pixels a side
    middle: Float[Tensor, "b c h2 w2"]  # 8
    coarse: Float[Tensor, "b c h3 w3"]  # 16


class Attention(nn.Module):
    """Attention among the cells of one window; `halves` takes the maximum of 2x2 queries."""

    def __init__(self, before: int, width: int, heads: int, halves: bool):
        super().__init__()
        self.heads, self.halves = heads, halves
        self.qkv = nn.Linear(before, 3 * width)
        self.proj = nn.Linear(width, width)

    def forward(self, x: Float[Tensor, "b h w c"]) -> Float[Tensor, "b h2 w2 c2"]:
        q, k, v = self.qkv(x).chunk(3, dim=-1)
        if self.halves:
            q = halved(q)
        h, w = q.shape[1:3]
        q, k, v = (
            rearrange(part, "b h w (g c) -> b g (h w) c", g=self.heads) for part in (q, k, v)
        )
        found = rearrange(attend(q, k, v), "b g (h w) c -> b h w (g c)", h=h, w=w)
        out: Tensor = self.proj(found)
        return out


class Feedforward(nn.Module):
    """Two layers."""

    def __init__(self, width: int):
        super().__init__()
        self.layers = nn.ModuleList([nn.Linear(width, 4 * width), nn.Linear(4 * width, width)])

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.layers[1](nn.functional.gelu(self.layers[0](x)))
        return out


class Block(nn.Module):
    """Attention within windows (0: everywhere) and a feed-forward net.

    Where the channels change the image's sides are halved as well.
    """

    def __init__(self, before: int, width: int, heads: int, window: int):
        super().__init__()
        self.window = window
        self.norm1 = nn.LayerNorm(before, eps=EPSILON)
        self.attn = Attention(before, width, heads, halves=before != width)
        self.norm2 = nn.LayerNorm(width, eps=EPSILON)
        self.mlp = Feedforward(width)
        self.proj = nn.Linear(before, width) if before != width else None

    def forward(self, x: Float[Tensor, "b h w c"]) -> Float[Tensor, "b h2 w2 c2"]:
        normed = self.norm1(x)
        kept = x if self.proj is None else halved(self.proj(normed))
        x = kept + self._attended(normed, kept.shape[1], kept.shape[2])
        out: Tensor = x + self.mlp(self.norm2(x))
        return out

    def _attended(self, x: Tensor, h: int, w: int) -> Tensor:
        if not self.window:
            whole: Tensor = self.attn(x)
            return whole
        window = self.window // 2 if self.proj is not None else self.window
        return joined(self.attn(windows(x, self.window)), window, h, w)


class PatchEmbed(nn.Module):
    """Images to overlapping patches."""

    def __init__(self, width: int):
        super().__init__()
        self.proj = nn.Conv2d(3, width, 7, stride=STRIDE, padding=3)

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Float[Tensor, "b h w c"]:
        patches: Tensor = self.proj(images)
        return rearrange(patches, "b c h w -> b h w c")


class Hiera(nn.Module):
    """Images to the features of four stages, the finest first."""

    def __init__(self, variant: Variant):
        super().__init__()
        self.patch_embed = PatchEmbed(variant.width)
        side, window = variant.background, variant.windows[0]
        self.pos_embed = nn.Parameter(torch.empty(1, variant.width, side, side))
        self.pos_embed_window = nn.Parameter(torch.empty(1, variant.width, window, window))
        nn.init.trunc_normal_(self.pos_embed, std=0.02)
        nn.init.trunc_normal_(self.pos_embed_window, std=0.02)
        self.blocks = nn.ModuleList(_blocks(variant))
        self.ends = [sum(variant.stages[: stage + 1]) - 1 for stage in range(4)]

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> list[Tensor]:
        x = self.patch_embed(images)
        x = x + self._position(x.shape[1], x.shape[2])
        stages = []
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in self.ends:
                stages.append(rearrange(x, "b h w c -> b c h w"))
        return stages

    def _position(self, h: int, w: int) -> Float[Tensor, "1 h w c"]:
        far = nn.functional.interpolate(self.pos_embed, size=(h, w), mode="bicubic")
        near = self.pos_embed_window
        tiled = near.tile(1, 1, h // near.shape[2], w // near.shape[3])
        return rearrange(far + tiled, "1 c h w -> 1 h w c")


def _blocks(variant: Variant) -> list[Block]:
    blocks: list[Block] = []
    before = variant.width
    for stage, count in enumerate(variant.stages):
        width, heads = variant.width * 2**stage, variant.heads * 2**stage
        for place in range(count):
            # The block that halves the image still looks at windows of the stage before.
            window = variant.windows[max(stage - 1, 0) if place == 0 else stage]
            window = 0 if len(blocks) in variant.everywhere else window
            blocks.append(Block(before, width, heads, window))
            before = width
    return blocks


class Neck(nn.Module):
    """Brings all stages to one width and adds the coarsest to the one before it."""

    def __init__(self, variant: Variant):
        super().__init__()
        widths = [variant.width * 2**stage for stage in reversed(range(4))]
        self.convs = nn.ModuleList(
            nn.Sequential(OrderedDict(conv=nn.Conv2d(width, variant.neck, 1))) for width in widths
        )

    def forward(self, stages: list[Tensor]) -> Levels:
        top, coarse, middle, fine = (
            level(stage) for level, stage in zip(self.convs, reversed(stages), strict=True)
        )
        above = nn.functional.interpolate(top, scale_factor=2.0, mode="nearest")
        return Levels(fine, middle, coarse + above)


class ImageEncoder(nn.Module):
    """Images, their sides multiples of 32, to three levels of features."""

    def __init__(self, variant: Variant):
        super().__init__()
        self.trunk = Hiera(variant)
        self.neck = Neck(variant)

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Levels:
        levels: Levels = self.neck(self.trunk(images))
        return levels


def halved(x: Float[Tensor, "b h w c"]) -> Float[Tensor, "b h2 w2 c"]:
    """The maximum of every 2x2 cells."""
    pooled = nn.functional.max_pool2d(rearrange(x, "b h w c -> b c h w"), 2)
    return rearrange(pooled, "b c h w -> b h w c")


def windows(x: Float[Tensor, "b h w c"], size: int) -> Float[Tensor, "n size size c"]:
    """Windows of `size` cells a side; zeros fill up the last of a row and of a column."""
    h, w = x.shape[1:3]
    x = nn.functional.pad(x, (0, 0, 0, -w % size, 0, -h % size))
    return rearrange(x, "b (i p) (j q) c -> (b i j) p q c", p=size, q=size)


def joined(x: Float[Tensor, "n size size c"], size: int, h: int, w: int) -> Tensor:
    """The image (b h w c) that was cut into such windows."""
    rows, columns = -(-h // size), -(-w // size)
    x = rearrange(x, "(b i j) p q c -> b (i p) (j q) c", i=rows, j=columns)
    return x[:, :h, :w]
