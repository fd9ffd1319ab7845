"""RVT's trunk: who sees whom, what comes out, and the paper's sizes."""

import pytest
import torch
from torch import Tensor, nn

from seek_model.config import PatchTransformer, Views
from seek_model.patch_transformer import PatchTrunk
from seek_model.trunk import Seen, Words

WORDS = 6  # channels of the language
TOY = PatchTransformer(patch=4, channels=32, width=32, depth=2, heads=2)


def trunk(config: PatchTransformer = TOY, fingers: int = 3) -> PatchTrunk:
    torch.manual_seed(0)
    return PatchTrunk(config, Views(size=16), WORDS, fingers).eval()


def images(frames: int = 2) -> Tensor:
    return torch.rand(frames, 3, 10, 16, 16)


def words(frames: int = 2) -> Words:
    tokens = torch.randn(frames, 5, WORDS)
    mask = torch.arange(5) < torch.tensor([[3], [5]])[:frames]
    return Words(tokens, mask, tokens.mean(dim=1))


@torch.no_grad()
def seen(network: PatchTrunk, frames: Tensor, said: Words, fingers: Tensor | None = None) -> Seen:
    return network(frames, said, torch.full((len(frames), 3), 0.5) if fingers is None else fingers)


def test_a_trunk_gives_features_of_every_cell_and_the_encoders_mean() -> None:
    network = trunk()

    found = seen(network, images(), words())

    assert found.features.shape == (2, 3, network.channels, network.cells, network.cells)
    assert found.features.shape[2:] == (32, 4, 4)
    assert found.backbone.shape == (2, 3, network.backbone_channels)
    assert found.skips == () and network.skip_channels == ()


def test_a_first_convolution_leaves_its_pixels_as_a_skip() -> None:
    network = trunk(TOY.model_copy(update={"first_conv": 8}))

    found = seen(network, images(), words())

    assert network.skip_channels == (8,)
    assert [skip.shape for skip in found.skips] == [(6, 8, 16, 16)]


@pytest.mark.parametrize("first_conv", [0, 8])
def test_frames_of_a_batch_are_seen_as_if_alone(first_conv: int) -> None:
    network = trunk(TOY.model_copy(update={"first_conv": first_conv}))
    frames, said = images(), words()

    together = seen(network, frames, said)

    for row in range(2):
        alone = seen(network, frames[row : row + 1], Words(*(part[row : row + 1] for part in said)))
        torch.testing.assert_close(together.features[row], alone.features[0])
        torch.testing.assert_close(together.backbone[row], alone.backbone[0])


def test_words_count_only_where_the_mask_is_true() -> None:
    network, frames, said = trunk(), images(), words()
    before = seen(network, frames, said).features

    beyond = torch.where(said.mask[..., None], said.tokens, torch.tensor(9.0))
    same = seen(network, frames, said._replace(tokens=beyond)).features
    other = seen(network, frames, said._replace(tokens=said.tokens + 1)).features

    torch.testing.assert_close(before, same)
    assert (before - other).abs().max() > 1e-3


def test_the_first_half_of_the_layers_sees_one_view_and_no_words() -> None:
    network, frames = trunk(), images()
    network.transformer.across = nn.ModuleList()
    changed = frames.clone()
    changed[:, 1] = torch.rand(2, 10, 16, 16)

    before = seen(network, frames, words()).features
    after = seen(network, changed, words()).features

    torch.testing.assert_close(before[:, [0, 2]], after[:, [0, 2]])
    assert (before[:, 1] - after[:, 1]).abs().max() > 1e-3


def test_the_second_half_sees_all_views() -> None:
    network, frames, said = trunk(), images(), words()
    changed = frames.clone()
    changed[:, 1] = torch.rand(2, 10, 16, 16)

    before, after = (seen(network, each, said).features for each in (frames, changed))

    assert (before[:, [0, 2]] - after[:, [0, 2]]).abs().amax(dim=(2, 3, 4)).min() > 1e-5


def test_the_fingers_and_the_clock_are_told() -> None:
    network, frames, said = trunk(fingers=4), images(), words()

    early, late = (
        seen(network, frames, said, torch.tensor([[1.0, 0.04, 0.04, clock]] * 2)).features
        for clock in (1.0, -1.0)
    )

    assert (early - late).abs().max() > 1e-3


def test_attention_is_dropped_in_training_only() -> None:
    network, frames, said = trunk(), images(), words()

    assert torch.equal(seen(network, frames, said).features, seen(network, frames, said).features)
    network.train()
    assert not torch.equal(
        seen(network, frames, said).features, seen(network, frames, said).features
    )


@pytest.mark.parametrize(
    ("config", "views", "cells"),
    [
        (PatchTransformer(), Views(size=224), 16),
        (PatchTransformer(patch=11, first_conv=64), Views(count=5, size=220, stages=1), 20),
    ],
    ids=["RVT-2", "RVT"],
)
def test_the_papers_sizes(config: PatchTransformer, views: Views, cells: int) -> None:
    with torch.device("meta"):
        network = PatchTrunk(config, views, 512, 4)

    layers = [*network.transformer.within.parameters(), *network.transformer.across.parameters()]

    assert (network.cells, network.backbone_channels) == (cells, 64)
    assert network.transformer.position.shape == (views.count * cells**2, 128)
    assert len(network.transformer.within) == len(network.transformer.across) == 4
    assert sum(p.numel() for p in layers) == pytest.approx(33.6e6, rel=0.01)
