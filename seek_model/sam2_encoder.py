"""What SAM2Act takes of SAM 2.1: its image encoder and the two convolutions of its skips."""

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor, nn

from seek_model.hiera import ImageEncoder, Variant


class Encoded(NamedTuple):
    """Images, encoded."""

    top: Float[Tensor, "b c h w"]  # a cell is 16 pixels a side of the resized image
    skips: tuple[Tensor, Tensor]  # (b c/8 4h 4w), (b c/4 2h 2w)


class Sam2Encoder(nn.Module):
    """Colour images of any size to features; parts have Meta's names.

    Colours stay between 0 and 1: the ancestors do not shift them to the mean of photographs, and
    views of point clouds are mostly black.
    """

    def __init__(self, variant: Variant, image: int):
        super().__init__()
        self.image = image  # pixels a side, a multiple of 32
        self.channels = variant.neck
        self.skip_channels = (variant.neck // 8, variant.neck // 4)
        self.image_encoder = ImageEncoder(variant)
        self.conv_s0 = nn.Conv2d(variant.neck, self.skip_channels[0], 1)
        self.conv_s1 = nn.Conv2d(variant.neck, self.skip_channels[1], 1)

    def forward(self, colors: Float[Tensor, "b 3 s s"]) -> Encoded:
        side = (self.image, self.image)
        colors = nn.functional.interpolate(colors, side, mode="bilinear", align_corners=True)
        fine, middle, coarse = self.image_encoder(colors)
        return Encoded(coarse, (self.conv_s0(fine), self.conv_s1(middle)))
