"""A cube to be grasped."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, box
from hide_tasks.assets.colors import COLORS


@dataclass
class Block(Asset):
    """A cube; its frame is its centre."""

    color: str = "red"
    size: float = 0.04  # m; RLBench take_item_out_of_drawer
    mass: float = 0.064  # kg

    def __post_init__(self) -> None:
        shape = box((self.size,) * 3, (0, 0, 0), COLORS[self.color], bevel=0.003)
        self.links = (Link("block", (shape,), mass=self.mass, graspable=True, friction=1.0),)
