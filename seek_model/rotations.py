"""Rotations as bins of 5 degrees, as PerAct and RVT predict them, and as six numbers.

Quaternions are x y z w. Angles are turns about the world's x, then y, then z axis (scipy's "xyz").
A gripper that points straight down is turned by 180 degrees about x, where the bins wrap.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

BIN = 5.0  # degrees
BINS = 72  # a turn
LOCK = 1.0  # degrees from a y angle of +-90 where x and z are not told apart (RVT)

Array = NDArray[np.float64]


def encode(quaternion: Array) -> NDArray[np.int64]:
    """Bins (..., 3), 0 to 71, of the x, y and z angles of quaternions (..., 4) of any length.

    Bin i stands for 5 i - 180 degrees; those of y are 18 to 54. Near a y angle of +-90 degrees
    the z angle is 0.
    """
    angles = _angles(_matrix(quaternion))
    return np.round((angles + 180) / BIN).astype(np.int64) % BINS


def decode(bins: NDArray[np.int64]) -> Array:
    """Unit quaternions (..., 4), w >= 0, of bins (..., 3)."""
    angles = np.reshape(bins, (-1, 3)) * BIN - 180
    rotation = Rotation.from_euler("xyz", angles, degrees=True)
    return _quaternion(rotation).reshape(*np.shape(bins)[:-1], 4)


def six(quaternion: Array) -> Array:
    """The first and then the second column of the matrix, (..., 6), of quaternions (..., 4)."""
    columns = np.swapaxes(_matrix(quaternion), -1, -2)[..., :2, :]
    return columns.reshape(*columns.shape[:-2], 6)


def turned(quaternion: Array, yaw: float) -> Array:
    """The quaternions (..., 4) after a further turn by `yaw` rad about the world's z axis."""
    rotation = Rotation.from_rotvec([0.0, 0.0, yaw]) * _rotation(quaternion)
    return _quaternion(rotation).reshape(np.shape(quaternion))


def angle_between(first: Array, second: Array) -> Array:
    """Degrees, 0 to 180, from each rotation (..., 4) to the other."""
    first, second = np.broadcast_arrays(first, second)
    turn = _rotation(first).inv() * _rotation(second)
    return np.asarray(np.degrees(turn.magnitude()).reshape(first.shape[:-1]))


def _rotation(quaternion: Array) -> Rotation:
    return Rotation.from_quat(np.reshape(quaternion, (-1, 4)))


def _matrix(quaternion: Array) -> Array:
    matrix = _rotation(quaternion).as_matrix()
    return np.asarray(matrix.reshape(*np.shape(quaternion)[:-1], 3, 3))


def _quaternion(rotation: Rotation) -> Array:
    return np.asarray(rotation.as_quat(canonical=True))


def _angles(matrix: Array) -> Array:
    """Degrees (..., 3) of matrices Rz(z) Ry(y) Rx(x), (..., 3, 3)."""
    x = np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2])
    y = -np.arcsin(np.clip(matrix[..., 2, 0], -1, 1))
    z = np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0])
    angles = np.degrees(np.stack([x, y, z], axis=-1))
    locked = np.abs(angles[..., 1:2]) > 90 - LOCK
    return np.where(locked, _locked_angles(matrix), angles)


def _locked_angles(matrix: Array) -> Array:
    """The angles where y is close to +-90 degrees and only x -+ z can be told."""
    sign = -np.sign(matrix[..., 2, 0])
    x = np.arctan2(
        sign * matrix[..., 0, 1] - matrix[..., 1, 2], matrix[..., 1, 1] + sign * matrix[..., 0, 2]
    )
    return np.stack([np.degrees(x), 90 * sign, np.zeros_like(x)], axis=-1)
