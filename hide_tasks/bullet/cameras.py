"""Pinhole cameras of the benchmark: two shoulders, front, wrist.

Camera frames are OpenCV's: x right, y down, z forward. The centre of pixel (column x, row y) is
at image point (x + 0.5, y + 0.5). Places and angles of the fixed cameras are RLBench's.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hide_tasks.contract import CAMERAS

FloatArray = NDArray[np.float64]

SIZE = 128  # pixels, width and height of the benchmark's images
NEAR = 0.01  # m along the optical axis (RLBench)
WRIST = "wrist"
DECIMALS = 12  # kept of a camera's numbers, so that another machine's tangent changes nothing


@dataclass(frozen=True, eq=False)
class Camera:
    """What one image needs to be rendered, and to be projected back."""

    width: int
    height: int
    intrinsics: FloatArray  # (3, 3), pixels
    camera_to_world: FloatArray  # (4, 4), OpenCV axes
    near: float = NEAR  # m along the optical axis
    far: float = 4.5


class _Lens(NamedTuple):
    field_of_view: float  # degrees, over the longer side of the image
    far: float  # m


class _Mount(NamedTuple):
    position: tuple[float, float, float]  # m, world
    forward: tuple[float, float, float]


_LENSES = {
    "front": _Lens(40.0, 4.5),
    "left_shoulder": _Lens(40.0, 3.2),
    "right_shoulder": _Lens(40.0, 3.2),
    WRIST: _Lens(60.0, 3.5),
}
_MOUNTS = {
    "front": _Mount((1.35, 0.0, 1.58), (-0.906, 0.0, -0.423)),
    "left_shoulder": _Mount((-0.175, 0.20, 1.98), (0.416, -0.073, -0.906)),
    "right_shoulder": _Mount((-0.175, -0.20, 1.98), (0.416, 0.073, -0.906)),
}

# The wrist camera sits where a RealSense is bolted to the hand: beside the fingers on the side
# that looks away from the base at home, tipped towards the grasp point.
_WRIST_POSITION = (0.07, 0.0, 0.03)  # m, frame of panda_hand
_WRIST_TILT = np.radians(25.0)  # of the optical axis from the hand's z towards its -x


def camera(name: str, width: int = SIZE, height: int = SIZE) -> Camera:
    """Fixed camera `front`, `left_shoulder` or `right_shoulder`.

    Raises:
        ValueError: no fixed camera has that name; `wrist` needs the hand's pose (wrist_camera).
    """
    if name not in _MOUNTS:
        raise ValueError(f"No fixed camera {name!r}. Fixed: {', '.join(_MOUNTS)}")
    mount = _MOUNTS[name]
    pose = looking(np.array(mount.position), np.array(mount.forward))
    return Camera(width, height, intrinsics_for(name, width, height), pose, far=_LENSES[name].far)


def wrist_camera(hand_to_world: FloatArray, width: int = SIZE, height: int = SIZE) -> Camera:
    """Camera on the hand, for the pose (4, 4) of link panda_hand.

    The image's x is the fingers' closing direction; the fingertips stand in its lower half.
    """
    c, s = round(np.cos(_WRIST_TILT), DECIMALS), round(np.sin(_WRIST_TILT), DECIMALS)
    camera_to_hand = np.eye(4)
    camera_to_hand[:3, 1] = (-c, 0.0, -s)
    camera_to_hand[:3, 2] = (-s, 0.0, c)
    camera_to_hand[:3, 0] = np.cross(camera_to_hand[:3, 1], camera_to_hand[:3, 2])
    camera_to_hand[:3, 3] = _WRIST_POSITION
    intrinsics = intrinsics_for(WRIST, width, height)
    pose = np.asarray(hand_to_world, dtype=np.float64) @ camera_to_hand
    return Camera(width, height, intrinsics, pose, far=_LENSES[WRIST].far)


def intrinsics_for(name: str, width: int = SIZE, height: int = SIZE) -> FloatArray:
    """Intrinsics (3, 3), in pixels, of a camera of the benchmark at any resolution.

    Raises:
        ValueError: no camera has that name.
    """
    if name not in _LENSES:
        raise ValueError(f"No camera {name!r}. All: {', '.join(CAMERAS)}")
    half_angle = np.radians(_LENSES[name].field_of_view / 2.0)
    focal = round(max(width, height) / 2.0 / np.tan(half_angle), DECIMALS)
    return np.array([[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]])


def looking(position: FloatArray, forward: FloatArray) -> FloatArray:
    """Camera-to-world pose (4, 4) at `position` towards `forward`, the world's z up in the image.

    `forward` need not be of unit length but must not be vertical.
    """
    z = forward / np.linalg.norm(forward)
    right = np.cross(z, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.round(np.column_stack([right, np.cross(z, right), z]), DECIMALS) + 0.0
    pose[:3, 3] = position
    return pose
