"""A bell pepper: four lobes, a green stem."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box, cylinder
from hide_tasks.assets.colors import RGB

WIDTH = 0.062  # m across two lobes: the gripper opens 0.08
HEIGHT = 0.068  # m without the stem
STEM = 0.014  # m; a grasped thing may reach 0.042 above the tip
GRASP = 0.012  # m of the grasp point above its middle
LOBE = 0.019  # m, radius
QUARTER = 1.5707963267948966  # rad of turn after which it looks the same
RED: RGB = (206, 34, 28)
GREEN: RGB = (62, 128, 46)
PROFILE = ((0.0, -0.5), (0.55, -0.49), (0.8, -0.36), (0.92, -0.1), (1.0, 0.2), (0.86, 0.42))
DIMPLE = ((0.45, 0.5), (0.0, 0.46))  # of a lobe's top


@dataclass
class Pepper(Asset):
    """A pepper that stands on its lobes; its frame is its middle."""

    mass: float = 0.15  # kg
    loose: int = 0  # physics steps since the gripper last held it
    radius = 0.045

    def __post_init__(self) -> None:
        solid = Shape("box", (WIDTH - 0.004, WIDTH - 0.004, HEIGHT), RED, seen=False)
        away = WIDTH / 2 - LOBE
        lobes = tuple(_lobe(x * away, y * away) for x in (-1, 1) for y in (-1, 1))
        top = HEIGHT / 2
        stem = (
            cylinder(0.013, 0.004, (0, 0, top - 0.004), GREEN, solid=False),
            cylinder(0.0055, STEM, (0, 0, top + STEM / 2 - 0.003), GREEN, solid=False),
        )
        core = box((0.03, 0.03, HEIGHT * 0.84), (0, 0, 0), RED, solid=False)
        self.links = (
            Link(
                "pepper",
                (solid, core, *lobes, *stem),
                mass=self.mass,
                graspable=True,
                friction=1.0,
            ),
        )

    def act(self) -> None:
        """Count how long it has been left alone."""
        self.loose = 0 if self.body.held() else self.loose + 1


def _lobe(x: float, y: float) -> Shape:
    line = [(r * LOBE, z * HEIGHT) for r, z in (*PROFILE, *DIMPLE)]
    size = tuple(value for point in line for value in point)
    return Shape("lathe", size, RED, at=(x, y, 0, 0, 0, 0, 1), solid=False)
