"""The three decoders: shapes of the paper and of others, and what a convex step is."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from seek_model.trunk import Decoder
from seek_model.upsampling import ConvDecoder, ConvexDecoder, ConvexUp, MultiResolutionDecoder

Make = Callable[[int, int], tuple[nn.Module, tuple[Tensor, ...]]]  # cells, size: decoder, skips


def conv(cells: int, size: int) -> tuple[nn.Module, tuple[Tensor, ...]]:
    return ConvDecoder(16, size, cells, (6,)), (torch.randn(6, 6, size, size),)


def convex(cells: int, size: int) -> tuple[nn.Module, tuple[Tensor, ...]]:
    return ConvexDecoder(16, size, cells), ()


def multires(cells: int, size: int) -> tuple[nn.Module, tuple[Tensor, ...]]:
    skips = torch.randn(6, 4, 8, 8), torch.randn(6, 8, 4, 4)
    return MultiResolutionDecoder(16, (4, 8), size, cells), skips


DECODERS = pytest.mark.parametrize("make", [conv, convex, multires])


@DECODERS
@pytest.mark.parametrize(("cells", "size"), [(2, 28), (3, 33), (4, 32), (5, 25)])
def test_there_is_one_heat_map_a_view(make: Make, cells: int, size: int) -> None:
    torch.manual_seed(0)
    decoder, skips = make(cells, size)

    decoded = decoder(torch.randn(2, 3, 16, cells, cells), skips)

    assert decoded.logits.shape == (2, 3, size, size)
    assert decoded.logits.isfinite().all()


@DECODERS
def test_frames_of_a_batch_are_decoded_as_if_alone(make: Make) -> None:
    torch.manual_seed(0)
    decoder, skips = make(2, 28)
    features = torch.randn(2, 3, 16, 2, 2)

    together = decoder(features, skips).logits
    alone = decoder(features[1:], tuple(skip[3:] for skip in skips)).logits

    torch.testing.assert_close(together[1:], alone)


@DECODERS
def test_gradients_reach_all_of_a_decoder_its_features_and_skips(make: Make) -> None:
    torch.manual_seed(0)
    decoder, skips = make(2, 28)
    leaves = [torch.randn(2, 3, 16, 2, 2), *skips]
    for leaf in leaves:
        leaf.requires_grad_()

    decoder(leaves[0], tuple(leaves[1:])).logits.square().sum().backward()

    for tensor in [*leaves, *decoder.parameters()]:
        assert tensor.grad is not None and tensor.grad.abs().max() > 0


def test_rvts_decoder_gives_features_of_every_pixel() -> None:
    torch.manual_seed(0)
    decoder, skips = conv(4, 44)

    local = decoder(torch.randn(2, 3, 16, 4, 4), skips).local

    assert local is not None
    assert local.shape == (2, 3, decoder.local_channels, 44, 44)


def test_rvts_decoder_does_without_pixels_of_the_trunk() -> None:
    decoder: Decoder = ConvDecoder(16, 44, 4)

    assert decoder(torch.randn(1, 3, 16, 4, 4), ()).logits.shape == (1, 3, 44, 44)


def test_a_convex_step_stays_between_its_nine_neighbours() -> None:
    torch.manual_seed(0)
    step = ConvexUp(4, 1, ratio=3)
    x = torch.randn(1, 4, 5, 5)

    low, fine = step.low(x), step(x)

    padded = nn.functional.pad(low, (1, 1, 1, 1))
    most = nn.functional.max_pool2d(padded, 3, stride=1).repeat_interleave(3, 2)
    least = -nn.functional.max_pool2d(-padded, 3, stride=1).repeat_interleave(3, 2)
    assert fine.shape == (1, 1, 15, 15)
    assert (fine <= most.repeat_interleave(3, 3) + 1e-6).all()
    assert (fine >= least.repeat_interleave(3, 3) - 1e-6).all()


def test_a_convex_step_that_picks_its_own_cell_repeats_it() -> None:
    torch.manual_seed(0)
    step = ConvexUp(4, 2, ratio=2)
    bias = torch.full((9, 4), -1e4)
    bias[4] = 1e4  # the middle of nine
    nn.init.zeros_(step.mask[2].weight)
    step.mask[2].bias = nn.Parameter(bias.flatten())
    x = torch.randn(1, 4, 3, 3)

    expected = step.low(x).repeat_interleave(2, 2).repeat_interleave(2, 3)

    torch.testing.assert_close(step(x), expected)


def test_finer_cells_lie_where_their_weights_say() -> None:
    torch.manual_seed(0)
    step = ConvexUp(4, 1, ratio=2)
    bias = torch.full((9, 4), -1e4)
    bias[4, [0, 1, 3]] = 1e4  # three of the four finer cells: the middle
    bias[5, 2] = 1e4  # lower left: the neighbour on the right
    nn.init.zeros_(step.mask[2].weight)
    step.mask[2].bias = nn.Parameter(bias.flatten())
    x = torch.randn(1, 4, 3, 3)

    low, fine = step.low(x)[0, 0], step(x)[0, 0]

    torch.testing.assert_close(fine[2, 2], low[1, 1])
    torch.testing.assert_close(fine[3, 2], low[1, 2])


def test_the_multiresolution_decoder_keeps_full_precision() -> None:
    torch.manual_seed(0)
    decoder, skips = multires(2, 28)
    features = torch.randn(2, 3, 16, 2, 2)

    with torch.autocast("cpu", dtype=torch.bfloat16):
        decoded = decoder(features.bfloat16(), tuple(skip.bfloat16() for skip in skips))

    assert decoded.logits.dtype == torch.float32


@pytest.mark.parametrize(
    ("decoder", "cells", "size", "skips"),
    [
        (lambda: ConvDecoder(128, 220, 20, (64,)), 20, 220, [(64, 220)]),
        (lambda: ConvexDecoder(128, 224, 16), 16, 224, []),
        (lambda: MultiResolutionDecoder(128, (32, 64), 224, 16), 16, 224, [(32, 64), (64, 32)]),
    ],
    ids=["RVT", "RVT-2", "SAM2Act"],
)
def test_the_papers_sizes(
    decoder: Callable[[], nn.Module], cells: int, size: int, skips: list[tuple[int, int]]
) -> None:
    # Precision is no notion of the meta device, and SAM2Act's decoder sets its own.
    with torch.device("cpu" if len(skips) > 1 else "meta"), torch.no_grad():
        taken = tuple(torch.empty(1, channels, side, side) for channels, side in skips)
        decoded = decoder()(torch.empty(1, 1, 128, cells, cells), taken)

    assert decoded.logits.shape == (1, 1, size, size)
