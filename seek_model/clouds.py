"""Point clouds of the workspace, from depth images, and the cube that the network sees them in.

Nothing is random: the same images give the same cloud, in the same order.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from hide_tasks.contract import CAMERAS, Observation
from hide_tasks.layout import BOUNDS

CENTER = tuple(round((low + high) / 2, 6) for low, high in BOUNDS)  # m: 0.2, 0, 1.1
SCALE = 2 / (BOUNDS[0][1] - BOUNDS[0][0])  # cube units a metre; all sides are equal

P = TypeVar("P", NDArray[np.float32], NDArray[np.float64], Tensor)


class Cloud(NamedTuple):
    """Coloured points."""

    points: NDArray[np.float32]  # (n, 3) m, world
    colors: NDArray[np.uint8]  # (n, 3)


def to_cube(p: P) -> P:
    """World positions (..., 3) in m, in the cube: BOUNDS becomes [-1, 1] along each axis."""
    return (p - _center(p)) * SCALE


def from_cube(p: P) -> P:
    """World positions (..., 3) in m of positions in the cube."""
    return p / SCALE + _center(p)


def _center(p: P) -> P:
    if isinstance(p, Tensor):
        return p.new_tensor(CENTER)
    return np.asarray(CENTER, p.dtype)


def cloud_of(observation: Observation, points: int, voxel: float) -> Cloud:
    """What the observation's cameras see of the workspace: see `cloud_of_images`."""
    views = [observation.views[name] for name in CAMERAS if name in observation.views]
    return cloud_of_images(
        [view.depth for view in views],
        [view.rgb for view in views],
        [view.intrinsics for view in views],
        [view.camera_to_world for view in views],
        points=points,
        voxel=voxel,
    )


def cloud_of_images(
    depths: Sequence[NDArray[np.float32]] | NDArray[np.float32],
    rgbs: Sequence[NDArray[np.uint8]] | NDArray[np.uint8],
    intrinsics: Sequence[NDArray[np.float64]] | NDArray[np.float64],
    camera_to_world: Sequence[NDArray[np.float64]] | NDArray[np.float64],
    *,
    points: int,
    voxel: float,
) -> Cloud:
    """What cameras see inside BOUNDS, thinned; one entry of each argument per camera.

    Args:
        depths: (h, w), m along the optical axis.
        rgbs: (h, w, 3).
        intrinsics: (3, 3), pixel centres at +0.5.
        camera_to_world: (4, 4), x right, y down, z forward.
        points: the most that are kept.
        voxel: m; one point of each voxel is kept, all if 0.

    Raises:
        ValueError: nothing that the cameras see is inside BOUNDS.
    """
    cameras = zip(depths, rgbs, intrinsics, camera_to_world, strict=True)
    parts = [_seen_by(*camera) for camera in cameras]
    positions = np.concatenate([part.points for part in parts])
    if not len(positions):
        raise ValueError(
            f"no camera sees a point of the workspace, {BOUNDS} m; expected depth in metres "
            "along the optical axis and camera_to_world with x right, y down, z forward"
        )
    colors = np.concatenate([part.colors for part in parts])
    return thin(Cloud(positions, colors), voxel, points)


def thin(cloud: Cloud, voxel: float, most: int) -> Cloud:
    """The first point of every voxel (all points if `voxel` is 0), then at most `most` of them.

    The grid of voxels (m a side) stands still in the world. Which points make room depends on
    their count alone; what is left keeps its order.
    """
    if voxel:
        cloud = _take(cloud, _first_of_each_voxel(cloud.points, voxel))
    if len(cloud.points) > most:
        # Of numpy's generators this is the one whose numbers never change with a release.
        order = np.random.RandomState(0).permutation(len(cloud.points))
        cloud = _take(cloud, np.sort(order[:most]))
    return cloud


def _take(cloud: Cloud, rows: NDArray[np.int64]) -> Cloud:
    return Cloud(cloud.points[rows], cloud.colors[rows])


def _first_of_each_voxel(points: NDArray[np.float32], voxel: float) -> NDArray[np.int64]:
    """Ascending rows of `points`."""
    cells = np.floor(np.ascontiguousarray(points.T) / voxel).astype(np.int64)
    x, y, z = cells - cells.min(axis=1, keepdims=True)
    keys = (x * (y.max() + 1) + y) * (z.max() + 1) + z
    # Sorting the rows along with the keys is faster than an argsort. The numbers fit in 64 bits
    # for voxels from 0.1 mm on.
    cell, row = np.divmod(np.sort(keys * len(points) + np.arange(len(points))), len(points))
    return np.sort(row[np.diff(cell, prepend=-1) > 0])


def _seen_by(
    depth: NDArray[np.float32],
    rgb: NDArray[np.uint8],
    intrinsics: NDArray[np.float64],
    camera_to_world: NDArray[np.float64],
) -> Cloud:
    """The points of one image that are inside BOUNDS, in the order of its pixels."""
    rows, columns = np.nonzero(np.isfinite(depth) & (depth > 0))
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
    rays = camera_to_world[:3, :3] @ np.linalg.inv(intrinsics) @ pixels
    points = (rays * depth[rows, columns] + camera_to_world[:3, 3:]).T.astype(np.float32)
    inside = np.logical_and.reduce(list(_within_bounds(points)))
    return Cloud(points[inside], rgb[rows[inside], columns[inside]])


def _within_bounds(points: NDArray[np.float32]) -> Iterator[NDArray[np.bool_]]:
    for axis, (low, high) in enumerate(BOUNDS):
        yield (points[:, axis] >= low) & (points[:, axis] <= high)
