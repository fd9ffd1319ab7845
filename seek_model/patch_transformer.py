"""RVT's and RVT-2's trunk: a transformer over the patches of all views (models.md 1.4, 1.5).

The first half of its layers looks within each view, the second half at all views and the words.
f frames, v views, d channels of a token, h = w cells a side, l words, p entries of `fingers`.
"""

import math

import torch
from einops import rearrange, repeat
from jaxtyping import Bool, Float
from torch import Tensor, nn

from seek_model.attention import attend
from seek_model.config import PatchTransformer, Views
from seek_model.trunk import Seen, Words

PIXEL_CHANNELS = 10
LEAK = 0.02  # of every leaky ReLU (RVT)
GROUPS = 4  # of every group normalisation (RVT)
FEEDFORWARD = 4  # times the width, gate not counted


def activated(layer: nn.Conv2d | nn.Linear) -> nn.Sequential:
    """A layer, its normalisation in groups of channels and a leaky ReLU."""
    channels = layer.out_channels if isinstance(layer, nn.Conv2d) else layer.out_features
    norm = nn.GroupNorm(math.gcd(GROUPS, channels), channels)
    return nn.Sequential(layer, norm, nn.LeakyReLU(LEAK))


def cut(channels: int, width: int, patch: int) -> nn.Sequential:
    """Images (n channels s s) to one vector a patch (n width s/patch s/patch)."""
    return activated(nn.Conv2d(channels, width, patch, stride=patch))


class Gated(nn.Module):
    """GEGLU: a feed-forward net half of whose inner channels gate the others (Shazeer 2020)."""

    def __init__(self, width: int):
        super().__init__()
        self.rise = nn.Linear(width, 2 * FEEDFORWARD * width)
        self.fall = nn.Linear(FEEDFORWARD * width, width)

    def forward(self, x: Float[Tensor, "b n d"]) -> Float[Tensor, "b n d"]:
        inner, gate = self.rise(x).chunk(2, dim=-1)
        out: Tensor = self.fall(inner * nn.functional.gelu(gate))
        return out


class Layer(nn.Module):
    """Attention among tokens, then a gated feed-forward net; both after a normalisation."""

    def __init__(self, config: PatchTransformer):
        super().__init__()
        width = config.width
        self.heads, self.dropout = config.heads, config.dropout
        self.norm, self.norm_after = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv = nn.Linear(width, 3 * width, bias=False)
        self.out = nn.Linear(width, width)
        self.feedforward = Gated(width)

    def forward(
        self, tokens: Float[Tensor, "b n d"], mask: Bool[Tensor, "b 1 1 n"] | None = None
    ) -> Float[Tensor, "b n d"]:
        """The tokens, told of those that `mask` lets be seen."""
        qkv = rearrange(
            self.qkv(self.norm(tokens)), "b n (three g c) -> three b g n c", three=3, g=self.heads
        )
        dropped = self.dropout if self.training else 0.0
        found = attend(qkv[0], qkv[1], qkv[2], mask=mask, dropout=dropped)
        tokens = tokens + self.out(rearrange(found, "b g n c -> b n (g c)"))
        out: Tensor = tokens + self.feedforward(self.norm_after(tokens))
        return out


class ViewTransformer(nn.Module):
    """Tokens of all views and the words of an instruction to features of the same shape."""

    def __init__(self, config: PatchTransformer, views: int, cells: int, words: int):
        super().__init__()
        self.position = nn.Parameter(torch.randn(views * cells * cells, config.channels))
        self.told = activated(nn.Linear(words, config.channels))
        self.lift = nn.Linear(config.channels, config.width)
        self.lower = nn.Linear(config.width, config.channels)
        within = config.depth // 2
        self.within = nn.ModuleList(Layer(config) for _ in range(within))
        self.across = nn.ModuleList(Layer(config) for _ in range(config.depth - within))

    def forward(
        self, tokens: Float[Tensor, "f v d h w"], words: Words
    ) -> Float[Tensor, "f v d h w"]:
        """Features of every cell; words where the mask is False change nothing."""
        frames, views, _, h, w = tokens.shape
        x = rearrange(tokens, "f v d h w -> f (v h w) d") + self.position
        x = rearrange(self.lift(x), "f (v n) d -> (f v) n d", v=views)
        for layer in self.within:
            x = layer(x)
        x = torch.cat([self._said(words), rearrange(x, "(f v) n d -> f (v n) d", f=frames)], dim=1)
        mask = _visible(words.mask, len(self.position))
        for layer in self.across:
            x = layer(x, mask)
        features: Tensor = self.lower(x[:, words.mask.shape[1] :])
        return rearrange(features, "f (v h w) d -> f v d h w", v=views, h=h, w=w)

    def _said(self, words: Words) -> Float[Tensor, "f l d"]:
        told = self.told(rearrange(words.tokens, "f l d -> (f l) d"))
        said: Tensor = self.lift(rearrange(told, "(f l) d -> f l d", l=words.tokens.shape[1]))
        return said


def _visible(words: Bool[Tensor, "f l"], cells: int) -> Bool[Tensor, "f 1 1 n"]:
    seen = torch.ones(len(words), cells, dtype=torch.bool, device=words.device)
    return torch.cat([words, seen], dim=1)[:, None, None]


def spread(channels: Float[Tensor, "f c"], like: Tensor) -> Float[Tensor, "f v c h w"]:
    """The same for every view and cell of `like` (f v d h w)."""
    _, v, _, h, w = like.shape
    return repeat(channels, "f c -> f v c h w", v=v, h=h, w=w)


class PatchEncoder(nn.Module):
    """Images to patches; RVT mixes the channels of each pixel first."""

    def __init__(self, config: PatchTransformer, width: int):
        super().__init__()
        first = config.first_conv
        self.mix = (
            nn.Sequential(nn.Conv2d(PIXEL_CHANNELS, first, 1), nn.LeakyReLU(LEAK))
            if first
            else None
        )
        self.cut = cut(first or PIXEL_CHANNELS, width, config.patch)

    def forward(self, images: Float[Tensor, "n 10 s s"]) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Patches (n width h w), and the mixed pixels (n first s s) where there are any."""
        if self.mix is None:
            return self.cut(images), ()
        pixels = self.mix(images)
        return self.cut(pixels), (pixels,)


class PatchTrunk(nn.Module):
    """A trunk (`trunk.Trunk`): half of a token's channels from its patch, half from the fingers."""

    def __init__(self, config: PatchTransformer, views: Views, words: int, fingers: int):
        super().__init__()
        self.channels, self.cells = config.channels, views.size // config.stride
        self.skip_channels = (config.first_conv,) if config.first_conv else ()
        self.backbone_channels = config.channels - config.channels // 2
        self.encoder = PatchEncoder(config, self.backbone_channels)
        self.fingers = activated(nn.Linear(fingers, config.channels // 2))
        self.transformer = ViewTransformer(config, views.count, self.cells, words)

    def forward(
        self, images: Float[Tensor, "f v 10 s s"], words: Words, fingers: Float[Tensor, "f p"]
    ) -> Seen:
        patches, skips = self.encoder(images.flatten(0, 1))
        patches = rearrange(patches, "(f v) d h w -> f v d h w", v=images.shape[1])
        tokens = torch.cat([patches, spread(self.fingers(fingers), patches)], dim=2)
        return Seen(self.transformer(tokens, words), skips, patches.mean(dim=(3, 4)))
