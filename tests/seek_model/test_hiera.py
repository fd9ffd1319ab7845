"""SAM 2.1's image encoder: Meta's names, shapes and sizes, and what a window sees."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seek_model.hiera import VARIANTS, Block, Hiera, ImageEncoder, halved, joined, windows

PUBLISHED = {
    "trunk.patch_embed.proj.weight": (112, 3, 7, 7),
    "trunk.pos_embed": (1, 112, 14, 14),
    "trunk.pos_embed_window": (1, 112, 8, 8),
    "trunk.blocks.0.norm1.weight": (112,),
    "trunk.blocks.1.attn.qkv.weight": (336, 112),
    "trunk.blocks.2.proj.weight": (224, 112),
    "trunk.blocks.2.attn.qkv.weight": (672, 112),
    "trunk.blocks.5.attn.qkv.weight": (1344, 224),
    "trunk.blocks.21.attn.qkv.weight": (2688, 448),
    "trunk.blocks.21.attn.proj.bias": (896,),
    "trunk.blocks.23.mlp.layers.0.weight": (3584, 896),
    "trunk.blocks.23.mlp.layers.1.weight": (896, 3584),
    "trunk.blocks.23.norm2.bias": (896,),
    "neck.convs.0.conv.weight": (256, 896, 1, 1),
    "neck.convs.3.conv.weight": (256, 112, 1, 1),
}  # of sam2.1_hiera_base_plus.pt


def test_parameters_have_published_names_and_shapes() -> None:
    with torch.device("meta"):
        own = {
            k: tuple(v.shape) for k, v in ImageEncoder(VARIANTS["base_plus"]).state_dict().items()
        }

    assert PUBLISHED.items() <= own.items()
    assert len(own) == 4 + 24 * 12 + 3 * 2 + 4 * 2


@pytest.mark.parametrize(
    ("variant", "millions"),
    [("tiny", 27.2), ("small", 34.3), ("base_plus", 69.1), ("large", 212.7)],
)
def test_an_encoder_has_the_published_size(variant: str, millions: float) -> None:
    with torch.device("meta"):
        encoder = ImageEncoder(VARIANTS[variant])

    assert sum(p.numel() for p in encoder.parameters()) / 1e6 == pytest.approx(millions, abs=0.05)


@pytest.mark.parametrize("variant", ["tiny", "small", "base_plus", "large"])
def test_the_first_block_of_a_stage_looks_at_windows_of_the_stage_before(variant: str) -> None:
    sizes = VARIANTS[variant]
    with torch.device("meta"):
        blocks = Hiera(sizes).blocks

    starts = [sum(sizes.stages[:stage]) for stage in range(1, 4)]

    assert [blocks[start].window for start in starts] == list(sizes.windows[:3])
    assert [n for n, block in enumerate(blocks) if not block.window] == list(sizes.everywhere)


@pytest.mark.parametrize("side", [32, 64])
def test_levels_are_a_fourth_an_eighth_and_a_sixteenth_of_the_image(side: int) -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder(VARIANTS["toy"])

    levels = encoder(torch.rand(2, 3, side, side))

    assert [level.shape for level in levels] == [
        (2, 32, side // by, side // by) for by in (4, 8, 16)
    ]


def test_images_of_a_batch_are_encoded_as_if_alone() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder(VARIANTS["toy"]).eval()
    images = torch.rand(2, 3, 64, 64)

    with torch.no_grad():
        together, alone = encoder(images), encoder(images[1:])

    for both, one in zip(together, alone, strict=True):
        torch.testing.assert_close(both[1:], one)


@pytest.mark.parametrize(("window", "reaches"), [(4, False), (0, True)])
def test_a_block_sees_its_window_or_everything(window: int, reaches: bool) -> None:
    torch.manual_seed(0)
    block = Block(8, 8, heads=2, window=window)
    image = torch.rand(1, 8, 8, 8)
    changed = image.clone()
    changed[:, 7, 7] = torch.rand(8)

    with torch.no_grad():
        differences = (block(image) - block(changed)).abs().amax(dim=(0, 3))

    assert bool(differences[4:, 4:].min() > 0)
    assert bool(differences[:4, :4].max() > 0) == reaches


@settings(max_examples=20)
@given(h=st.integers(1, 9), w=st.integers(1, 9), size=st.integers(1, 5))
def test_windows_join_to_the_image_that_was_cut(h: int, w: int, size: int) -> None:
    image = torch.arange(2.0 * h * w * 3).view(2, h, w, 3)

    assert torch.equal(joined(windows(image, size), size, h, w), image)


def test_halving_takes_the_maximum_of_four() -> None:
    image = torch.arange(16.0).view(1, 4, 4, 1)

    assert halved(image).flatten().tolist() == [5, 7, 13, 15]
