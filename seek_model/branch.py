"""A branch sees images and says where: a trunk, a decoder, and a summary for the other heads."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from seek_model import heatmaps, named_colors
from seek_model.config import ConvFilm, Model, PatchTransformer, Views
from seek_model.conv_film import ConvFilmTrunk, PyramidDecoder
from seek_model.patch_transformer import PatchTrunk
from seek_model.sam2_encoder import Sam2Encoder
from seek_model.sam2_trunk import Sam2Trunk
from seek_model.trunk import Decoder, Trunk
from seek_model.upsampling import ConvDecoder, ConvexDecoder, MultiResolutionDecoder
from seek_model.views import VirtualCameras

FINGERS = 3
CLOCK = 1  # more, where the clock is told


def cameras_of(views: Views) -> VirtualCameras:
    """The cameras of a configuration."""
    return VirtualCameras(views.count, views.size, views.layers, views.behind)


def make_trunk(model: Model, words: int, encoder: Sam2Encoder | None) -> Trunk:
    """The trunk of a configuration; `encoder` is SAM 2's, which both branches share."""
    fingers = FINGERS + CLOCK * model.clock
    backbone = model.backbone
    if isinstance(backbone, ConvFilm):
        pixels = cameras_of(model.views).channels
        pixels += named_colors.channels(model.language.colors, model.views.layers)
        return ConvFilmTrunk(backbone, model.views, words, fingers, pixels)
    if isinstance(backbone, PatchTransformer):
        return PatchTrunk(backbone, model.views, words, fingers)
    assert encoder is not None
    return Sam2Trunk(backbone, model.views, words, fingers, encoder)


def make_decoder(model: Model, trunk: Trunk) -> Decoder:
    """The decoder of a configuration."""
    size, channels, skips = model.views.size, trunk.channels, trunk.skip_channels
    if model.decoder == "conv":
        return ConvDecoder(channels, size, trunk.cells, skips)
    if model.decoder == "convex":
        return ConvexDecoder(channels, size, trunk.cells)
    if model.decoder == "multires":
        return MultiResolutionDecoder(channels, skips, size, trunk.cells)
    return PyramidDecoder(channels, skips, size)


class Branch(nn.Module):
    """Trunk and decoder of one look, coarse or fine."""

    def __init__(self, model: Model, words: int, encoder: Sam2Encoder | None):
        super().__init__()
        self.cameras = cameras_of(model.views)
        self.trunk = make_trunk(model, words, encoder)
        self.decoder = make_decoder(model, self.trunk)

    def images(
        self,
        points: Float[Tensor, "p 3"],
        colors: Float[Tensor, "p 3"],
        owner: Int[Tensor, " p"],
        frames: int,
        named: Float[Tensor, "f n 4"] | None,
    ) -> Float[Tensor, "f v c s s"]:
        """What the trunk sees of frames; `named` are the colours of their instructions, if told."""
        found = self.cameras.render(points, colors, owner, frames)
        return found if named is None else named_colors.compared(found, named, self.cameras.red)

    @property
    def summary_channels(self) -> int:
        """Of `summary`."""
        return 2 * self.trunk.channels * self.cameras.count

    def summary(
        self, features: Float[Tensor, "f v d h w"], place: Float[Tensor, "f 3"]
    ) -> Float[Tensor, "f k"]:
        """Each view's strongest features, and those at a place in this branch's cube."""
        pixels = self.cameras.project(place)
        there = heatmaps.at(features, pixels, self.cameras.size)
        return torch.cat([features.amax(dim=(3, 4)), there], dim=-1).flatten(1)
