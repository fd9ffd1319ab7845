"""SAM 2's encoder as SAM2Act uses it."""

import torch

from seek_model.hiera import VARIANTS
from seek_model.sam2_encoder import Sam2Encoder


def test_images_of_any_size_are_brought_to_the_encoders() -> None:
    torch.manual_seed(0)
    encoder = Sam2Encoder(VARIANTS["toy"], image=64)

    encoded = encoder(torch.rand(2, 3, 50, 50))

    assert encoded.top.shape == (2, 32, 4, 4)
    assert [skip.shape for skip in encoded.skips] == [(2, 4, 16, 16), (2, 8, 8, 8)]


def test_the_papers_skips_have_32_and_64_channels() -> None:
    with torch.device("meta"):
        encoder = Sam2Encoder(VARIANTS["base_plus"], image=256)

    assert encoder.skip_channels == (32, 64)
    assert encoder.conv_s0.weight.shape == (32, 256, 1, 1)
    assert encoder.conv_s1.weight.shape == (64, 256, 1, 1)
