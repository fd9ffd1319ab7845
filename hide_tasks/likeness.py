"""How alike two observations are: the alias tolerance of the certificates."""

from typing import NamedTuple

import numpy as np

from hide_tasks.contract import Observation

RGB_STEP = 8  # of 255: a channel that differs by more is seen
DEPTH_STEP = 0.002  # m
PIXELS = 0.005  # share of a camera's pixels that may differ
JOINTS = 0.005  # rad
OPENING = 0.05  # of the gripper, 0 to 1


class Likeness(NamedTuple):
    """The distance of two observations, camera by camera."""

    pixels: dict[str, float]  # share of pixels that differ visibly
    joints: float  # largest difference, rad
    opening: float  # difference of the gripper's opening, 0 to 1

    @property
    def alike(self) -> bool:
        """True within the alias tolerance."""
        return (
            max(self.pixels.values()) <= PIXELS
            and self.joints <= JOINTS
            and self.opening <= OPENING
        )

    @property
    def distance(self) -> float:
        """One number to order by; at most 3 when alike."""
        pixels = max(self.pixels.values())
        return pixels / PIXELS + self.joints / JOINTS + self.opening / OPENING


def likeness(a: Observation, b: Observation) -> Likeness:
    """Compare two observations of scenes with the same layout."""
    return Likeness(
        pixels={name: _differing(a, b, name) for name in a.views},
        joints=float(np.abs(a.joint_positions - b.joint_positions).max()),
        opening=abs(a.gripper_opening - b.gripper_opening),
    )


def alike(a: Observation, b: Observation) -> bool:
    """True within the alias tolerance: `likeness(a, b).alike`, ended by the first difference."""
    return (
        bool(np.abs(a.joint_positions - b.joint_positions).max() <= JOINTS)
        and abs(a.gripper_opening - b.gripper_opening) <= OPENING
        and all(_differing(a, b, name) <= PIXELS for name in a.views)
    )


def _differing(a: Observation, b: Observation, name: str) -> float:
    one, two = a.views[name], b.views[name]
    far = np.maximum(one.rgb, two.rgb) - np.minimum(one.rgb, two.rgb) > RGB_STEP
    color = far[..., 0] | far[..., 1] | far[..., 2]  # eight times as fast as any(axis=-1)
    depth = np.abs(one.depth - two.depth) > DEPTH_STEP
    return float((color | depth).mean())
