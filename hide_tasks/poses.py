"""Poses and rotations in numpy. A pose is (7,): x y z qx qy qz qw; a transform is (4, 4)."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quaternion(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Array:
    """x y z w of the rotation Rz(yaw) Ry(pitch) Rx(roll), angles in rad."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def pose(x: float, y: float, z: float, rotation: Array | None = None) -> Array:
    """A pose (7,) from a position in metres and a quaternion (default: not turned)."""
    turned = np.array([0.0, 0.0, 0.0, 1.0]) if rotation is None else rotation
    return np.concatenate([[x, y, z], turned]).astype(np.float64)


def rotation_matrix(q: Array) -> Array:
    """(3, 3) of a quaternion of any length but zero."""
    x, y, z, w = q / math.sqrt(float(q @ q))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def multiply(a: Array, b: Array) -> Array:
    """The quaternion that turns by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def from_rotation_vector(vector: Array) -> Array:
    """The quaternion that turns about a vector (3,) by its length in rad."""
    angle = math.sqrt(float(vector @ vector))
    axis = vector / angle if angle > 1e-12 else vector
    return np.concatenate([axis * math.sin(angle / 2), [math.cos(angle / 2)]])


def matrix(p: Array) -> Array:
    """(4, 4) of a pose."""
    result = np.eye(4)
    result[:3, :3] = rotation_matrix(p[3:])
    result[:3, 3] = p[:3]
    return result


def compose(a: Array, b: Array) -> Array:
    """The pose b, given in the frame a, in a's parent frame."""
    return np.concatenate([a[:3] + rotation_matrix(a[3:]) @ b[:3], multiply(a[3:], b[3:])])


def point(p: Array, x: float, y: float, z: float) -> Array:
    """The world position (3,) of a point given in the frame p."""
    return np.asarray(p[:3] + rotation_matrix(p[3:]) @ np.array([x, y, z]))


def yaw_of(p: Array) -> float:
    """The heading of a pose's x axis in the horizontal plane, rad."""
    x_axis = rotation_matrix(p[3:])[:, 0]
    return math.atan2(x_axis[1], x_axis[0])
