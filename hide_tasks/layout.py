"""Where the things of one episode stand. All its randomness is the episode's own generator."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from hide_tasks.assets.asset import Asset
from hide_tasks.assets.seat import Seat
from hide_tasks.poses import Array, pose, quaternion

TABLE_TOP = 0.752  # m, RLBench
BOUNDS = ((-0.3, 0.7), (-0.5, 0.5), (0.6, 1.6))  # m, RLBench's scene bounds: x, y, z
DRAWS = 10_000  # attempts at a layout before it is called impossible

A = TypeVar("A", bound=Asset)


class Crowded(RuntimeError):
    """An area has no room for its assets."""


@dataclass(frozen=True)
class Area:
    """A rectangle on the table, m."""

    x: tuple[float, float]
    y: tuple[float, float]


class Layout:
    """The assets of one episode, in the order in which they were added."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.assets: list[Asset] = []
        self.seats: list[Seat] = []

    def add(self, asset: A, x: float, y: float, *, z: float = TABLE_TOP, yaw: float = 0.0) -> A:
        """The asset, standing at (x, y) and turned by `yaw` rad."""
        asset.at = pose(x, y, z, quaternion(yaw=yaw))
        self.assets.append(asset)
        return asset

    def add_at(self, asset: A, at: Array) -> A:
        """The asset, at a pose (7,)."""
        asset.at = at
        self.assets.append(asset)
        return asset

    def seat(self, seat: Seat) -> Seat:
        """A seat, from now on."""
        self.seats.append(seat)
        return seat

    def hold(self, things: Iterable[Asset]) -> None:
        """Each stands exactly where it is until taken: then no grasp tells what was before."""
        for thing in things:
            self.seat(Seat(thing, thing.at, firm=True, taken=True))

    def scatter(self, assets: Iterable[A], area: Area, *, gap: float, turn: float = 0.0) -> list[A]:
        """The assets at random places of the area, their circles at least `gap` apart.

        Each is turned by at most `turn` rad either way.

        Raises:
            Crowded: no room was found.
        """
        things = list(assets)
        for _ in range(DRAWS):
            points = self._points(len(things), area)
            if all(
                math.dist(points[i], points[j]) >= gap + things[i].radius + things[j].radius
                for i in range(len(things))
                for j in range(i)
            ):
                break
        else:
            raise Crowded(f"No room for {len(things)} assets, {gap} m apart, in {area}.")
        yaws = self.rng.uniform(-turn, turn, len(things))
        return [
            self.add(thing, x, y, yaw=yaw)
            for thing, (x, y), yaw in zip(things, points, yaws.tolist(), strict=True)
        ]

    def between(self, low: float, high: float) -> float:
        """A uniform number."""
        return float(self.rng.uniform(low, high))

    def _points(self, count: int, area: Area) -> list[tuple[float, float]]:
        corner = np.array([area.x, area.y])
        drawn = self.rng.uniform(corner[:, 0], corner[:, 1], (count, 2))
        return [(float(x), float(y)) for x, y in drawn]

    def scene_hash(self, instruction: str) -> str:
        """SHA-256 of the quantised description; the same on every machine."""
        description = {"instruction": instruction, "assets": [a.describe() for a in self.assets]}
        text = json.dumps(description, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
