"""A mug: a hollow cup with a handle."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box, shade
from hide_tasks.assets.colors import COLORS

RADIUS = 0.03  # m; RLBench's cup is as wide
HEIGHT = 0.08  # m
WALL = 0.004  # m
HANDLE = 0.024  # m that its handle stands out along x


@dataclass
class Mug(Asset):
    """A mug that stands upright; its frame is its middle, x towards its handle."""

    color: str = "red"
    mass: float = 0.1  # kg

    def __post_init__(self) -> None:
        color = COLORS[self.color]
        body = Shape("cylinder", (RADIUS, HEIGHT), color, seen=False)
        shapes = (body, Shape("lathe", _OUTLINE, color, solid=False), *_handle(shade(color, 0.8)))
        self.links = (Link("mug", shapes, mass=self.mass, graspable=True, friction=1.0),)


_TOP, _INNER = HEIGHT / 2, RADIUS - WALL
_OUTLINE = (
    0,
    -_TOP,
    RADIUS,
    -_TOP,
    RADIUS,
    _TOP,
    _INNER,
    _TOP,
    _INNER,
    WALL - _TOP,
    0,
    WALL - _TOP,
)


def _handle(color: tuple[int, int, int]) -> tuple[Shape, ...]:
    thick, high = 0.007, 0.05
    return (
        box((thick, thick, high), (RADIUS + HANDLE - thick / 2, 0, 0), color, solid=False),
        *(
            box(
                (HANDLE, thick, thick),
                (RADIUS + HANDLE / 2 - 0.001, 0, end * (high - thick) / 2),
                color,
                solid=False,
            )
            for end in (-1, 1)
        ),
    )
