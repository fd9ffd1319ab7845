"""A crumpled sheet that is longer than wide: what it lies on is not to be seen."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Link, Shape
from hide_tasks.assets.rubbish import FOLDS, HEIGHT, PAPERS, WIDTH, Paper, fold

LENGTH = 0.11  # m
APART = 0.030  # m between its crumpled parts, along it


@dataclass
class Sheet(Paper):
    """A long crumpled sheet; its frame is its middle, x along its length."""

    radius = 0.06

    def __post_init__(self) -> None:
        core = Shape("box", (LENGTH, WIDTH, HEIGHT), PAPERS[0], seen=False)
        folds = (fold(i, part * APART) for part in (-1, 0, 1) for i in range(len(FOLDS)))
        self.links = (Link("paper", (core, *folds), mass=0.03, graspable=True),)
