"""Clouds hold what the cameras see of the workspace, and no more of it than asked for."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hide_tasks.contract import CAMERAS, CameraView, Observation
from hide_tasks.layout import BOUNDS
from seek_model.clouds import Cloud, cloud_of, cloud_of_images, from_cube, thin, to_cube

INTRINSICS = np.array([[150.0, 0.0, 64.0], [0.0, 150.0, 64.0], [0.0, 0.0, 1.0]])
FACING_THE_ROBOT = np.array(  # from 1.2 m in front of the robot's base, 1.1 m up
    [[0.0, 0.0, -1.0, 1.2], [1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.1], [0.0, 0.0, 0.0, 1.0]]
)


def observed(depth, rgb):
    view = CameraView(rgb, depth.astype(np.float32), INTRINSICS, FACING_THE_ROBOT)
    pose = np.array([0.3, 0.0, 1.2, 0.0, 0.0, 0.0, 1.0])
    return Observation(dict.fromkeys(CAMERAS, view), pose, 1.0, np.zeros(7), "do it")


def scattered(count):
    rng = np.random.default_rng(count)
    low, high = np.array(BOUNDS).T
    points = rng.uniform(low, high, (count, 3)).astype(np.float32)
    return Cloud(points, rng.integers(0, 256, (count, 3), dtype=np.uint8))


def test_the_corners_of_the_workspace_are_those_of_the_cube():
    low, high = np.array(BOUNDS).T

    np.testing.assert_allclose(to_cube(low), [-1, -1, -1], atol=1e-12)
    np.testing.assert_allclose(to_cube(high), [1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(to_cube(np.array([0.2, 0.0, 1.1])), [0, 0, 0], atol=1e-12)


@given(hnp.arrays(np.float32, (5, 3), elements=st.floats(-2, 2, width=32)))
def test_the_cube_and_the_world_are_each_others_inverse(points):
    for kind in (points, torch.from_numpy(points)):
        there_and_back = from_cube(to_cube(kind))

        assert type(there_and_back) is type(kind) and there_and_back.dtype == kind.dtype
        np.testing.assert_allclose(np.asarray(there_and_back), points, atol=1e-5)


@given(st.integers(40, 88), st.integers(40, 88), st.floats(0.6, 1.4))
def test_a_pixel_becomes_the_world_point_that_projects_on_its_centre(row, column, depth):
    depths = np.full((128, 128), np.inf)
    depths[row, column] = depth
    rgb = np.zeros((128, 128, 3), np.uint8)
    rgb[row, column] = (1, 2, 3)

    cloud = cloud_of(observed(depths, rgb), points=100, voxel=0.005)

    (point,) = cloud.points.astype(np.float64)
    x, y, z = np.linalg.inv(FACING_THE_ROBOT)[:3] @ [*point, 1.0]
    assert z == pytest.approx(depth, abs=1e-5)
    assert 150 * x / z + 64 == pytest.approx(column + 0.5, abs=1e-3)
    assert 150 * y / z + 64 == pytest.approx(row + 0.5, abs=1e-3)
    assert cloud.colors.tolist() == [[1, 2, 3]]


def test_right_and_down_in_an_image_are_left_of_the_robot_and_down_in_the_world():
    depths = np.full((128, 128), np.nan)
    depths[20, 100] = 1.0

    cloud = cloud_of(observed(depths, np.zeros((128, 128, 3), np.uint8)), points=9, voxel=0.01)

    (point,) = cloud.points
    np.testing.assert_allclose(point, [0.2, 36.5 / 150, 1.1 + 43.5 / 150], atol=1e-6)


def test_only_finite_points_of_the_workspace_are_kept():
    depths = np.full((128, 128), 1.0)
    depths[0] = np.nan
    depths[1] = np.inf
    depths[2] = 0.0
    depths[3] = 4.5
    depths[4] = -1.0

    cloud = cloud_of_images(
        depths[None].astype(np.float32),
        np.zeros((1, 128, 128, 3), np.uint8),
        INTRINSICS[None],
        FACING_THE_ROBOT[None],
        points=10**6,
        voxel=0.0,
    )

    assert len(cloud.points) == 123 * 128
    assert cloud.points.dtype == np.float32 and cloud.colors.dtype == np.uint8
    assert all(
        low <= cloud.points[:, axis].min() and cloud.points[:, axis].max() <= high
        for axis, (low, high) in enumerate(BOUNDS)
    )


def test_a_workspace_that_no_camera_sees_is_an_error():
    nothing = observed(np.full((128, 128), 9.0), np.zeros((128, 128, 3), np.uint8))

    with pytest.raises(ValueError, match="no camera sees a point of the workspace"):
        cloud_of(nothing, points=100, voxel=0.005)


@pytest.mark.parametrize("voxel", [0.013, 0.05, 0.4])
def test_the_first_point_of_every_voxel_is_kept(voxel):
    cloud = scattered(600)
    first = {}
    for number, point in enumerate(cloud.points):
        first.setdefault(tuple(np.floor(point / voxel).astype(int)), number)
    expected = sorted(first.values())

    thinned = thin(cloud, voxel, most=600)

    np.testing.assert_array_equal(thinned.points, cloud.points[expected])
    np.testing.assert_array_equal(thinned.colors, cloud.colors[expected])


def test_a_voxel_of_zero_keeps_all_points():
    cloud = scattered(50)

    thinned = thin(Cloud(*(np.repeat(part, 2, axis=0) for part in cloud)), 0.0, most=100)

    assert len(thinned.points) == 100


@given(st.integers(1, 200), st.integers(1, 200))
def test_no_more_points_are_left_than_asked_for_in_their_order(count, most):
    cloud = Cloud(
        np.arange(3 * count, dtype=np.float32).reshape(-1, 3), np.zeros((count, 3), np.uint8)
    )

    thinned = thin(cloud, 0.0, most)

    assert len(thinned.points) == min(count, most)
    assert (np.diff(thinned.points[:, 0]) > 0).all()


def test_what_makes_room_depends_on_the_number_of_points_alone():
    one, other = scattered(500), scattered(500)
    other = other._replace(points=other.points[::-1])

    rows = [
        [cloud.points.tolist().index(point) for point in thin(cloud, 0.0, 100).points.tolist()]
        for cloud in (one, other)
    ]

    assert rows[0] == rows[1]


def test_the_same_images_give_the_same_cloud():
    rng = np.random.default_rng(0)
    view = observed(
        rng.uniform(0.5, 1.5, (128, 128)), rng.integers(0, 256, (128, 128, 3), dtype=np.uint8)
    )

    first, second = (cloud_of(view, points=700, voxel=0.02) for _ in range(2))

    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.colors, second.colors)
    assert len(first.points) == 700
