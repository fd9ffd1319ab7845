"""SAM2Act's trunk: RVT-2's transformer, whose tokens also hold SAM 2.1's features (models.md 1.11).

One encoder serves the coarse and the fine look; all else is each trunk's own.
"""

from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.config import Sam2, Views
from seek_model.hiera import MULTIPLE, VARIANTS
from seek_model.lora import add_lora
from seek_model.patch_transformer import PIXEL_CHANNELS, ViewTransformer, activated, cut, spread
from seek_model.sam2_encoder import Encoded, Sam2Encoder
from seek_model.sam2_weights import load_encoder
from seek_model.trunk import Seen, Words
from seek_model.upsampling import resized

COLORS = slice(3, 6)  # of a pixel's channels


def make_encoder(config: Sam2) -> Sam2Encoder:
    """The encoder that both looks share, with the weights of `config.weights` if there are any.

    With LoRA only that and the convolutions of the skips are trained; without, all is.

    Raises:
        FileNotFoundError: there is no such file of weights.
        ValueError: `config.image` does not suit the encoder, or the file does not fit.
    """
    if config.image % MULTIPLE:
        raise ValueError(f"backbone.image = {config.image}; SAM 2 needs a multiple of {MULTIPLE}")
    encoder = Sam2Encoder(VARIANTS[config.encoder], config.image)
    if config.weights:
        load_encoder(encoder, Path(config.weights))
    if config.lora:
        add_lora(encoder.image_encoder, config.lora)
    return encoder


class Sam2Trunk(nn.Module):
    """A trunk (`trunk.Trunk`).

    Of a token's channels 3/8 are SAM 2's, 3/8 the patch's, the rest (1/4) the fingers'.
    """

    def __init__(self, config: Sam2, views: Views, words: int, fingers: int, encoder: Sam2Encoder):
        super().__init__()
        self.channels, self.cells = config.channels, views.size // config.stride
        self.skip_channels, self.backbone_channels = encoder.skip_channels, encoder.channels
        self.encoder = encoder
        part = 3 * config.channels // 8
        self.narrow = activated(nn.Conv2d(encoder.channels, part, 1))
        self.cut = cut(PIXEL_CHANNELS, part, config.stride)
        self.fingers = activated(nn.Linear(fingers, config.channels - 2 * part))
        self.transformer = ViewTransformer(config.transformer, views.count, self.cells, words)

    def forward(
        self, images: Float[Tensor, "f v 10 s s"], words: Words, fingers: Float[Tensor, "f p"]
    ) -> Seen:
        views, pixels = images.shape[1], images.flatten(0, 1)
        encoded: Encoded = self.encoder(pixels[:, COLORS])
        narrow = resized(self.narrow(encoded.top), self.cells)
        cells = torch.cat([narrow, self.cut(pixels)], dim=1)
        cells = rearrange(cells, "(f v) d h w -> f v d h w", v=views)
        tokens = torch.cat([cells, spread(self.fingers(fingers), cells)], dim=2)
        pooled = rearrange(encoded.top.mean(dim=(2, 3)), "(f v) k -> f v k", v=views)
        return Seen(self.transformer(tokens, words), encoded.skips, pooled)
