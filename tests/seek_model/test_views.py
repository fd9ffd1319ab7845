"""Virtual views show the nearest points, where they are."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seek_model import views
from seek_model.views import EMPTY, LOOKS, VirtualCameras, unzoomed, zoomed

INSIDE = st.floats(-0.999, 0.999)
POINT = st.tuples(INSIDE, INSIDE, INSIDE).map(torch.tensor)


def rendered(cameras, points, colors=None, owner=None, frames=1):
    colors = torch.ones_like(points) if colors is None else colors
    owner = torch.zeros(len(points), dtype=torch.long) if owner is None else owner
    return cameras.render(points, colors, owner, frames)


def lit(image):
    """Rows and columns of the pixels that show something."""
    return {(row, column) for row, column in (image[3:6].sum(dim=0) > 0).nonzero().tolist()}


def splat(size):
    radius = max(1.0, 0.012 * size / 2)
    reach = range(-3, 4)
    return [(r, c) for r in reach for c in reach if math.hypot(r, c) <= radius]


def drawn_by_hand(cameras, points, colors, owner, frames):
    """The first seven channels, one point and one pixel at a time."""
    size = cameras.size
    images = torch.zeros(frames, cameras.count, 7, size, size)
    pixels = cameras.project(points).clamp(max=size - 1).tolist()
    inside = [p for p, point in enumerate(points) if point.abs().max() <= 1]
    for frame in range(frames):
        for view, look in enumerate(cameras.looks):
            axis, sign = look.forward
            levels = ((sign * points[:, axis] + 1) * 1000).int().tolist()
            seen = {}
            for p in inside:
                if owner[p] == frame:
                    column, row = map(int, pixels[p][view])
                    seen[row, column] = min(seen.get((row, column), (EMPTY, EMPTY)), (levels[p], p))
            depths = {}
            for row in range(size):
                for column in range(size):
                    near = [(row + r, column + c) for r, c in splat(size)]
                    found = [seen[place] for place in near if place in seen]
                    if found:
                        _, p = min(found)
                        images[frame, view, :3, row, column] = points[p]
                        images[frame, view, 3:6, row, column] = colors[p]
                        depths[row, column] = sign * points[p, axis]
            images[frame, view, 6] = -1
            for (row, column), depth in depths.items():
                images[frame, view, 6, row, column] = depth - sum(depths.values()) / len(depths)
    return images


@pytest.mark.parametrize("chunk", [7, 10**6])
@pytest.mark.parametrize(("count", "size"), [(3, 8), (5, 13)])
def test_the_renderer_agrees_with_drawing_by_hand(count, size, chunk, monkeypatch):
    torch.manual_seed(size)
    monkeypatch.setattr(views, "CHUNK", chunk)
    points = torch.rand(100, 3) * 2.4 - 1.2
    points[50:60] = points[40:50]  # ties
    points[0], points[1] = torch.tensor([1.0, -1.0, 1.0]), torch.tensor([-1.0, 1.0, -1.0])
    colors, owner = torch.rand(100, 3), torch.randint(0, 2, (100,))
    cameras = VirtualCameras(count, size)

    images = cameras.render(points, colors, owner, 2)

    torch.testing.assert_close(
        images[:, :, :7],
        drawn_by_hand(cameras, points, colors, owner, 2),
        atol=1e-5,
        rtol=0.0,
    )


@pytest.mark.parametrize("size", [16, 64, 400])
@settings(max_examples=10)
@given(point=POINT)
def test_a_point_lights_its_pixel_and_the_neighbours_in_every_view(size, point):
    cameras = VirtualCameras(5, size)

    (images,) = rendered(cameras, point[None])

    for image, (u, v) in zip(images, cameras.project(point).tolist(), strict=True):
        expected = {(int(v) + r, int(u) + c) for r, c in splat(size)}
        assert lit(image) == {(r, c) for r, c in expected if min(r, c) >= 0 and max(r, c) < size}


def test_splats_are_a_pixel_and_its_four_neighbours_up_to_224_pixels():
    (images,) = rendered(VirtualCameras(3, 224), torch.tensor([[0.1, 0.2, 0.3]]))

    assert [len(lit(image)) for image in images] == [5, 5, 5]


@pytest.mark.parametrize(
    ("name", "right", "down", "near"),
    [
        ("top", (1, 0, 0), (0, -1, 0), (0, 0, 1)),
        ("front", (0, 1, 0), (0, 0, -1), (1, 0, 0)),
        ("right", (-1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ("back", (0, -1, 0), (0, 0, -1), (-1, 0, 0)),
        ("left", (1, 0, 0), (0, 0, -1), (0, -1, 0)),
    ],
)
def test_the_axes_of_the_images_are_those_of_the_world(name, right, down, near):
    view = [look.name for look in LOOKS].index(name)
    cameras = VirtualCameras(5, 100)
    right, down, near = (torch.tensor(axis, dtype=torch.float) for axis in (right, down, near))

    pixel = cameras.project(0.5 * right - 0.3 * down)[view]
    images = rendered(cameras, torch.stack([0 * near, 0.5 * near]))

    torch.testing.assert_close(pixel, torch.tensor([75.0, 35.0]))
    torch.testing.assert_close(images[0, view, :3, 50, 50], 0.5 * near)
    assert torch.equal(torch.linalg.cross(right, down), -near)  # no view is a mirror image


@settings(max_examples=30)
@given(point=POINT)
def test_a_grid_of_voxels_projects_on_the_centres_of_pixels(point):
    cameras = VirtualCameras(5, 32)
    centre = ((point + 1) * 16).floor().add(0.5) / 16 - 1

    pixels = cameras.project(centre)

    torch.testing.assert_close(pixels % 1, torch.full((5, 2), 0.5), atol=1e-4, rtol=0.0)


def test_any_number_of_leading_axes_is_projected():
    torch.manual_seed(0)
    cameras, points = VirtualCameras(3, 20), torch.rand(2, 4, 3)

    pixels = cameras.project(points)

    assert pixels.shape == (2, 4, 3, 2)
    torch.testing.assert_close(pixels[1, 2], cameras.project(points[1, 2]))


def test_the_nearest_point_is_shown_and_the_first_of_equals():
    points = torch.tensor([[0.0, 0.0, 0.1], [0.0, 0.0, 0.5], [0.0, 0.0, 0.5]])
    colors = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    top = rendered(VirtualCameras(3, 8), points, colors)[0, 0]

    assert top[3:6, 4, 4].tolist() == [0.0, 1.0, 0.0]


def test_points_outside_the_cube_are_not_drawn():
    points = torch.tensor([[0.0, 0.0, 1.01], [1.2, 0.0, 0.0], [0.0, math.nan, 0.0]])

    images = rendered(VirtualCameras(5, 8), points)

    assert not images[:, :, :6].any()
    assert (images[:, :, 6] == -1).all()


def test_a_frame_without_points_is_empty():
    images = rendered(VirtualCameras(3, 8), torch.zeros(0, 3), frames=2)

    assert images.shape == (2, 3, 10, 8, 8)
    assert not images[:, :, :6].any()


def test_the_last_channels_say_where_a_pixel_is():
    places = rendered(VirtualCameras(3, 5), torch.zeros(1, 3))[0, :, 7:]

    assert places[:, 0, 2, 2].tolist() == [-1.0, 0.0, 1.0]
    assert places[0, 1, :, 0].tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    assert places[0, 2, 0].tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]


def test_many_frames_at_once_are_each_frame_alone():
    torch.manual_seed(1)
    points, colors = torch.rand(300, 3) * 2 - 1, torch.rand(300, 3)
    owner = torch.arange(3).repeat_interleave(100)
    cameras = VirtualCameras(3, 16)

    together = cameras.render(points, colors, owner, 3)

    alone = [
        rendered(cameras, points[owner == frame], colors[owner == frame]) for frame in range(3)
    ]
    torch.testing.assert_close(together, torch.cat(alone))


def test_the_second_layer_shows_the_farthest_point_of_a_pixel():
    torch.manual_seed(0)
    places = [(torch.randperm(40) + 0.5) / 20 - 1 for _ in range(3)]  # no two as deep
    cloud, colors = torch.stack(places, dim=1), torch.rand(40, 3)
    cameras = VirtualCameras(5, 8, layers=2)

    both = rendered(cameras, cloud, colors)[0]

    assert both.shape[1] == 17
    torch.testing.assert_close(both[:, :10], rendered(VirtualCameras(5, 8), cloud, colors)[0])
    pixels = cameras.project(cloud).long()
    for view, (axis, sign) in enumerate(look.forward for look in LOOKS):
        for column, row in pixels[:, view].unique(dim=0).tolist():
            there = (pixels[:, view] == torch.tensor([column, row])).all(dim=1)
            farthest = int((sign * cloud[:, axis]).masked_fill(~there, -2).argmax())
            torch.testing.assert_close(both[view, 10:13, row, column], cloud[farthest])
            torch.testing.assert_close(both[view, 13:16, row, column], colors[farthest])


def test_what_lies_flat_on_a_table_is_seen_under_what_hides_it():
    """A chip of two by two pixels, nearly as low as the table, a block over it."""
    steps = torch.arange(-31.5, 32) / 32
    table = torch.cartesian_prod(steps, steps, torch.tensor([-0.5]))
    chip = (table[:, :2].abs() < 2 / 32).all(dim=1)
    table[chip, 2] = -0.49
    block = torch.cartesian_prod(steps[24:40], steps[24:40], torch.tensor([0.2]))
    colors = torch.zeros(len(table) + len(block), 3)
    colors[: len(table), 0] = chip.float()

    top = rendered(VirtualCameras(1, 64, layers=2), torch.cat([table, block]), colors)[0, 0]

    assert not top[3].any()
    assert int(top[13].sum()) == int(chip.sum())


def test_what_is_behind_the_cube_is_shown_where_nothing_in_it_is():
    points = torch.tensor([[0.0, 0.0, -3.0], [0.5, 0.5, -3.0], [0.5, 0.5, 0.5], [0.0, 0.0, 1.1]])
    colors = torch.tensor([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    top, front, right = rendered(VirtualCameras(3, 8, behind=True), points, colors)[0]

    assert top[3:6, 4, 4].tolist() == [1.0, 0.0, 0.0]  # far below; what is above is not drawn
    assert top[2, 4, 4] == -1.5  # told as if it were near
    assert top[3:6, 2, 6].tolist() == [0.0, 1.0, 0.0]
    assert front[3].max() == right[3].max() == 0  # beside their images


def test_without_it_nothing_behind_the_cube_is_shown():
    below = torch.tensor([[0.0, 0.0, -3.0]])

    assert not rendered(VirtualCameras(3, 8), below)[:, :, :6].any()
    assert not rendered(VirtualCameras(3, 8, layers=2, behind=True), below)[:, :, 10:16].any()


@settings(max_examples=30)
@given(point=POINT, center=POINT, zoom=st.floats(1.0, 8.0))
def test_a_zoomed_point_comes_back(point, center, zoom):
    near = zoomed(point[None], torch.tensor([0]), center[None], zoom)

    torch.testing.assert_close(unzoomed(near, center[None], zoom), point[None])


def test_each_frame_is_zoomed_about_its_own_center():
    centers = torch.tensor([[0.5, 0.0, 0.0], [0.0, -0.5, 0.25]])
    owner = torch.tensor([1, 0, 1])

    near = zoomed(centers[owner], owner, centers, 4.0)

    assert not near.any()
