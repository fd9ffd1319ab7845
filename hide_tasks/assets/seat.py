"""A place where a thing comes to stand exactly, so that no inch tells where it came from."""

import math
from dataclasses import dataclass

import numpy as np

from hide_tasks.assets.asset import Asset
from hide_tasks.poses import Array, multiply, quaternion, rotation_matrix, yaw_of


@dataclass
class Seat:
    """Let go near a seat, its thing slides into it.

    `period` is the turn about the vertical, rad, after which the thing looks the same; it comes
    to stand at the nearest such turn. In a firm seat it comes to stand exactly as at the start,
    and stays, whatever pushes, until it is taken.
    """

    thing: Asset
    at: Array  # (7,) of the thing when it sits
    reach: float = 0.015  # m
    lean: float = 0.35  # rad that it may be tilted
    turn: float = math.pi  # rad about the vertical that it may be turned, of `period`
    period: float = 2 * math.pi
    firm: bool = False
    taken: bool = False  # the thing came to sit in it; if it is firm: sits in it now

    def offers(self, pose: Array) -> Array | None:
        """Where the thing would come to stand from a pose (7,); None: it is too far off."""
        if math.dist(pose[:3], self.at[:3]) > self.reach or self._lean(pose) > self.lean:
            return None
        turned = yaw_of(pose) - yaw_of(self.at)
        steps = round(turned / self.period)
        if abs(turned - steps * self.period) > self.turn:
            return None
        rotation = multiply(quaternion(yaw=steps * self.period), self.at[3:])
        return np.concatenate([self.at[:3], rotation])

    def _lean(self, pose: Array) -> float:
        up = rotation_matrix(pose[3:])[:, 2] @ rotation_matrix(self.at[3:])[:, 2]
        return math.acos(min(1.0, max(-1.0, float(up))))
