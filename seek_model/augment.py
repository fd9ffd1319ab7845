"""One shift and turn for a whole sequence, so that what it remembers stays where it was seen.

The turn is about the vertical through the workspace's middle; the shift comes after it.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from torch import Tensor

from seek_model.clouds import SCALE, to_cube
from seek_model.config import Augment
from seek_model.rotations import turned

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """Where a sequence's world is put in the cube."""

    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)  # cube units
    turn: float = 0.0  # rad

    def points(self, points: Float[Tensor, "p 3"]) -> Float[Tensor, "p 3"]:
        """Positions in the cube, put where they belong; they may be out of it."""
        turned = points @ torch.from_numpy(self._turned.T).to(points)
        return turned + points.new_tensor(self.shift)

    def positions(self, positions: Array) -> Array:
        """World positions (..., 3) in m, in the cube and put where they belong."""
        return np.asarray(to_cube(positions) @ self._turned.T + self.shift)

    def quaternions(self, quaternions: Array) -> Array:
        """Rotations (..., 4), turned."""
        return turned(quaternions, self.turn) if self.turn else quaternions

    @property
    def _turned(self) -> Array:
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


NONE = Placement()


def draw(rng: np.random.Generator, targets: Array, config: Augment) -> Placement:
    """A random placement under which all targets (n, 3), world m, are in the cube.

    None at all if there is none among `config.tries`.
    """
    for _ in range(config.tries):
        shift = rng.uniform(-1.0, 1.0, 3) * config.shift * SCALE
        turn = np.radians(rng.uniform(-1.0, 1.0) * config.turn)
        placement = Placement((float(shift[0]), float(shift[1]), float(shift[2])), float(turn))
        if (np.abs(placement.positions(targets)) <= 1.0).all():
            return placement
    return NONE


def inside(positions: Float[Tensor, "p 3"]) -> Bool[Tensor, " p"]:
    """Which positions are in the cube."""
    x, y, z = (positions.abs() <= 1.0).unbind(dim=1)
    return x & y & z
