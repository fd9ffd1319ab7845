"""Heat maps say where a point is, and are read back to the same point."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seek_model import heatmaps
from seek_model.views import VirtualCameras

INSIDE = st.floats(-0.999, 0.999)
NOT_AT_A_SIDE = st.tuples(*[st.floats(-0.9, 0.9)] * 3).map(torch.tensor)
POINT = st.tuples(INSIDE, INSIDE, INSIDE).map(torch.tensor)


def decoded_by_hand(logits, cameras):
    """Every voxel's score, looked up in every view."""
    size = cameras.size
    centres = (torch.arange(size) + 0.5) * 2 / size - 1
    grid = torch.cartesian_prod(centres, centres, centres)
    column, row = cameras.project(grid).long().unbind(-1)  # n v
    likely = logits.flatten(-2).softmax(-1).view_as(logits)
    views = torch.arange(cameras.count)
    scores = likely[:, views, row, column].mean(dim=-1)
    return grid[scores.argmax(dim=-1)]


@pytest.mark.parametrize("count", [3, 5])
@pytest.mark.parametrize("chunk", [1, 700, 10**6])
def test_decoding_agrees_with_looking_up_every_voxel(count, chunk, monkeypatch):
    torch.manual_seed(count)
    monkeypatch.setattr(heatmaps, "CHUNK", chunk)
    cameras = VirtualCameras(count, 12)
    logits = 3 * torch.randn(6, count, 12, 12)

    points = heatmaps.decode(logits, cameras)

    torch.testing.assert_close(points, decoded_by_hand(logits, cameras))


@settings(max_examples=30)
@given(point=POINT, count=st.sampled_from([3, 5]))
def test_the_target_of_a_point_is_decoded_to_its_voxel(point, count):
    cameras = VirtualCameras(count, 16)
    target = heatmaps.target(cameras.project(point[None]), 16)

    found = heatmaps.decode((target + 1e-9).log(), cameras)

    assert (found - point).abs().max() <= 1 / 16 + 1e-4


@settings(max_examples=30)
@given(
    point=st.tuples(*[st.floats(-0.9, 0.9)] * 3).map(torch.tensor), count=st.sampled_from([3, 5])
)
def test_the_top_of_a_bell_is_found_between_the_voxels(point, count):
    cameras = VirtualCameras(count, 32)
    far = cameras.project(point[None])[..., None, None, :]  # 1 v 1 1 2
    grid = torch.stack(torch.meshgrid(*[torch.arange(32) + 0.5] * 2, indexing="xy"), dim=-1)
    logits = -((grid - far) ** 2).sum(dim=-1) / (2 * heatmaps.SIGMA**2)

    found = heatmaps.peak(logits, cameras)

    assert (found - point).abs().max() < 1e-3 < 1 / 32


def test_the_top_of_a_flat_map_is_the_middle_of_a_voxel():
    cameras = VirtualCameras(3, 8)
    found = heatmaps.peak(torch.zeros(1, 3, 8, 8), cameras)
    torch.testing.assert_close(found, heatmaps.decode(torch.zeros(1, 3, 8, 8), cameras))


@settings(max_examples=30)
@given(u=st.floats(0, 32), v=st.floats(0, 32))
def test_a_target_sums_to_one_and_ends_after_three_sigma(u, v):
    (target,) = heatmaps.target(torch.tensor([[u, v]]), 32)

    rows, columns = target.nonzero().T
    distances = torch.hypot(columns + 0.5 - u, rows + 0.5 - v)
    assert target.sum().item() == pytest.approx(1.0, abs=1e-5)
    assert distances.max().item() <= 4.5 + 1e-4
    assert len(rows) >= 14


def test_a_target_is_centred_on_the_continuous_position():
    (target,) = heatmaps.target(torch.tensor([[12.3, 20.8]]), 40)

    centres = torch.arange(40) + 0.5
    assert (target.sum(dim=0) @ centres).item() == pytest.approx(12.3, abs=0.02)
    assert (target.sum(dim=1) @ centres).item() == pytest.approx(20.8, abs=0.02)
    ratio = target[20, 12] / target[20, 14]
    assert ratio.item() == pytest.approx(math.exp((2.2**2 - 0.2**2) / (2 * 1.5**2)), rel=1e-4)


def test_a_target_out_of_the_image_takes_no_part_in_the_loss():
    torch.manual_seed(0)
    target = heatmaps.target(torch.tensor([[[-50.0, 5.0], [8.0, 900.0], [8.0, 8.0]]]), 16)
    logits = torch.randn(1, 3, 16, 16, requires_grad=True)

    heatmaps.loss(logits, target).sum().backward()

    assert not target[0, :2].any() and target[0, 2].any()
    assert not logits.grad[0, :2].any() and logits.grad[0, 2].any()


def test_the_loss_is_the_cross_entropy_of_each_view_averaged():
    torch.manual_seed(0)
    logits = torch.randn(2, 4, 3, 8, 8)
    target = torch.rand(2, 4, 3, 8, 8)
    target = target / target.sum(dim=(-2, -1), keepdim=True)

    loss = heatmaps.loss(logits, target)

    likely = logits.exp() / logits.exp().sum(dim=(-2, -1), keepdim=True)
    expected = -(target * likely.log()).sum(dim=(-2, -1)).mean(dim=-1)
    torch.testing.assert_close(loss, expected)
    assert loss.shape == (2, 4)


def test_features_are_read_at_the_centres_of_their_cells():
    torch.manual_seed(0)
    features = torch.randn(2, 3, 5, 4, 4)
    centre = torch.tensor([2.5, 1.5]) * 8  # column 2, row 1 of cells of 8 pixels

    read = heatmaps.at(features, centre.expand(2, 3, 2), 32)

    torch.testing.assert_close(read, features[..., 1, 2])


@settings(max_examples=30)
@given(u=st.floats(4, 28), v=st.floats(4, 28))
def test_between_the_centres_features_are_linear(u, v):
    column = torch.arange(4.0).expand(4, 4)
    features = torch.stack([column, column.T])[None, None]  # c: column, row

    (read,) = heatmaps.at(features, torch.tensor([[[u, v]]]), 32)[0]

    torch.testing.assert_close(read, torch.tensor([u / 8 - 0.5, v / 8 - 0.5]), atol=1e-4, rtol=0)


def test_beyond_the_outermost_centres_features_stay_the_same():
    torch.manual_seed(0)
    features = torch.randn(1, 1, 5, 4, 4)

    read = heatmaps.at(features, torch.tensor([[[-9.0, 400.0]]]), 32)

    torch.testing.assert_close(read, features[..., 3, 0])
