"""Poses (7,) = x y z qx qy qz qw as transforms (4, 4), and back; metres."""

import math

import numpy as np
from numpy.typing import ArrayLike

from hide_tasks.bullet.kernels import Array, as_array, compiled


@compiled
def fill_matrix(pose: Array, matrix: Array) -> bool:
    """Write the transform (4, 4) of a pose; False when it is not finite or its quaternion is 0."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    size = x * x + y * y + z * z + w * w
    if not (1e-12 < size < 1e12 and abs(pose[0]) + abs(pose[1]) + abs(pose[2]) < 1e6):
        return False
    k = 2.0 / size
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = (
        1 - k * (y * y + z * z),
        k * (x * y - z * w),
        k * (x * z + y * w),
    )
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = (
        k * (x * y + z * w),
        1 - k * (x * x + z * z),
        k * (y * z - x * w),
    )
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = (
        k * (x * z - y * w),
        k * (y * z + x * w),
        1 - k * (x * x + y * y),
    )
    for r in range(3):
        matrix[r, 3], matrix[3, r] = pose[r], 0.0
    matrix[3, 3] = 1.0
    return True


@compiled
def fill_pose(matrix: Array, pose: Array) -> None:
    """Write the pose (7,) of a transform, with the quaternion's largest part positive."""
    a, b, c = matrix[0, 0], matrix[1, 1], matrix[2, 2]
    pose[:3] = matrix[:3, 3]
    square = np.array([1 + a - b - c, 1 - a + b - c, 1 - a - b + c, 1 + a + b + c])
    i = np.argmax(square)
    if i == 3:
        pose[3] = matrix[2, 1] - matrix[1, 2]
        pose[4] = matrix[0, 2] - matrix[2, 0]
        pose[5] = matrix[1, 0] - matrix[0, 1]
        pose[6] = square[3]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        pose[3 + i] = square[i]
        pose[3 + j] = matrix[j, i] + matrix[i, j]
        pose[3 + k] = matrix[k, i] + matrix[i, k]
        pose[6] = matrix[k, j] - matrix[j, k]
    size = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    for r in range(3, 7):
        pose[r] /= size


def pose_to_matrix(pose: ArrayLike) -> Array:
    """The transform (4, 4) of a pose (7,); its quaternion may have any length but zero.

    Raises:
        ValueError: the pose is not finite, its quaternion is zero, or it is not (7,).
    """
    matrix = np.empty((4, 4))
    if not fill_matrix(as_array(pose, (7,), "a pose"), matrix):
        raise ValueError(f"a pose needs finite numbers and a quaternion that is not zero: {pose!r}")
    return matrix


def matrix_to_pose(matrix: ArrayLike) -> Array:
    """The pose (7,) of a transform (4, 4); the largest part of its quaternion is positive."""
    pose = np.empty(7)
    fill_pose(as_array(matrix, (4, 4), "a transform"), pose)
    return pose
