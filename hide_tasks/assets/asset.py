"""An asset is a tree of rigid links with shapes; the first link is its base.

All lengths are metres, all masses kilograms. A link's frame coincides with its parent's when
its joint reads zero. The frame of what is loose is its centre of mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Protocol

import numpy as np

from hide_tasks.assets.colors import RGB
from hide_tasks.poses import Array, compose, pose


@dataclass(frozen=True)
class Shape:
    """One primitive part of a link."""

    kind: Literal["box", "cylinder", "sphere", "lathe"]
    size: tuple[float, ...]  # box: x y z; cylinder: radius height; sphere: radius; lathe: r z r z …
    color: RGB
    at: tuple[float, ...] = (0, 0, 0, 0, 0, 0, 1)  # pose in the link's frame
    solid: bool = True  # takes part in collisions
    seen: bool = True  # is drawn
    bevel: float = 0.0  # chamfer of a box's or cylinder's edges


@dataclass(frozen=True)
class Joint:
    """How a link moves against the base."""

    kind: Literal["slide", "hinge"]
    axis: tuple[float, float, float]
    lower: float
    upper: float
    spring: float = 0.0  # N or N m that pulls it back to zero
    friction: float = 0.0  # N or N m of stiction
    detent: float = 0.0  # below this reading it snaps shut to exactly zero
    snap: float = 15.0  # N or N m that pulls it shut within its detent
    start: float = 0.0
    origin: tuple[float, float, float] = (0, 0, 0)  # a point of a hinge's axis, base's frame


@dataclass(frozen=True)
class Link:
    """A rigid part."""

    name: str
    shapes: tuple[Shape, ...]
    mass: float = 0.0  # the base only: 0 means fixed to the world
    joint: Joint | None = None  # None for the base, and for what is fixed to it
    graspable: bool = False
    friction: float = 0.8
    damping: float = 0.0  # share of the velocity lost in a second


class Body(Protocol):
    """What the simulator gives an asset once it stands in a world."""

    def pose(self, link: int = 0) -> Array:
        """The link's pose (7,) in the world."""

    def position(self) -> tuple[float, float, float]:
        """The base's position in the world; cheap."""

    def joint(self, link: int) -> float:
        """The link's joint reading, m or rad, within its limits."""

    def load(self, link: int = 0) -> float:
        """How hard other things press on the link, N."""

    def place(self, pose: Array) -> None:
        """Put the base at a pose (7,), at rest."""

    def held(self) -> bool:
        """True while the gripper holds any link of it."""


@dataclass
class Asset:
    """A thing in a scene; subclasses say which."""

    links: Sequence[Link] = field(init=False, default=())
    at: Array = field(init=False, default_factory=lambda: pose(0, 0, 0))
    body: Body = field(init=False, repr=False)
    interlocked: ClassVar[bool] = False  # at most one joint may leave its detent at a time
    avoided: ClassVar[bool] = True  # the planner keeps away from it
    radius: ClassVar[float] = 0.05  # of the circle it needs on the table

    def pose(self, link: int = 0) -> Array:
        """The link's present pose in the world."""
        return self.body.pose(link)

    @property
    def position(self) -> tuple[float, float, float]:
        """The base's present position in the world; cheap enough for every physics step."""
        return self.body.position()

    def drawn(self, link: int) -> Array | None:
        """Where a link is drawn, pose (7,) in the world; None: it is not to be seen now."""
        return self.pose(link)

    def act(self) -> None:
        """What it does by itself, after every physics step: nothing."""

    @property
    def at_rest(self) -> bool:
        """False while it moves by itself; the arm waits for it."""
        return True

    def frame(self, x: float, y: float, z: float, rotation: Array | None = None) -> Array:
        """A pose given in the frame of the base, as it stands in the world at the start."""
        return compose(self.at, pose(x, y, z, rotation))

    def describe(self) -> dict[str, object]:
        """Type, quantised start pose, colours and joints: what the scene hash is made of."""
        return {
            "asset": type(self).__name__,
            "at": [round(float(value), 4) + 0.0 for value in self.at],
            "colors": [shape.color for link in self.links for shape in link.shapes],
            "joints": [round(link.joint.start, 4) for link in self.links if link.joint],
        }


def box(
    size: tuple[float, float, float],
    center: tuple[float, float, float],
    color: RGB,
    *,
    bevel: float = 0.0,
    solid: bool = True,
) -> Shape:
    """An upright box about a point of the link's frame."""
    return Shape("box", size, color, at=(*center, 0, 0, 0, 1), bevel=bevel, solid=solid)


def cylinder(
    radius: float,
    height: float,
    center: tuple[float, float, float],
    color: RGB,
    *,
    rotation: tuple[float, float, float, float] = (0, 0, 0, 1),
    bevel: float = 0.0,
    solid: bool = True,
) -> Shape:
    """A cylinder about a point of the link's frame; upright unless turned."""
    at = (*center, *rotation)
    return Shape("cylinder", (radius, height), color, at=at, bevel=bevel, solid=solid)


def shade(color: RGB, factor: float) -> RGB:
    """The colour, darker (factor < 1) or lighter."""
    r, g, b = (int(np.clip(round(channel * factor), 0, 255)) for channel in color)
    return r, g, b
