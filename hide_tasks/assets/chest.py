"""A chest of three drawers that faces the robot; at most one drawer can be open."""

from collections.abc import Iterator
from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Joint, Link, Shape, box, cylinder, shade
from hide_tasks.poses import Array, compose, pose

LEVELS = ("top", "middle", "bottom")  # also the order in which the experts search

# Full size, metres; sizes of RLBench's cabinet, which reopen_drawer scales by 0.7.
WIDTH = 0.375  # across, along y
DEPTH = 0.30
PITCH = 0.12  # from one drawer to the next
PLINTH = 0.103  # below the lowest drawer
WALL = 0.012
SHELF = 0.007  # between two drawers: no picture looks through the gaps between their fronts
LEDGE = 0.022  # of the top over the drawers' fronts
FLOOR = SHELF + 0.01  # of a drawer above its shelf's middle
TRAVEL = 0.21
DETENT = 0.02  # below this opening a drawer snaps shut, so that no gap tells which one it was
REACH = 0.045  # of a handle from its front panel
BAR = 0.007  # radius of a handle's bar
WOOD = (176, 132, 88)
METAL = (70, 72, 78)


@dataclass
class Drawer:
    """One drawer of a chest."""

    chest: "Chest"
    level: str

    @property
    def link(self) -> int:
        """Its link in the chest."""
        return 1 + LEVELS.index(self.level)

    @property
    def opening(self) -> float:
        """How far it is pulled out, m."""
        return self.chest.body.joint(self.link)

    @property
    def handle(self) -> Array:
        """The present pose of its handle's middle, x into the chest."""
        return compose(self.chest.pose(self.link), self.chest.handle_offset(self.level))

    @property
    def floor(self) -> Array:
        """The present pose of the middle of its floor's upper side."""
        height = self.chest.height_of(self.level) - 0.5 * self.chest.pitch + FLOOR
        return compose(self.chest.pose(self.link), pose(0, 0, height))

    def item_at_start(self, *, behind_front: float, aside: float, above: float) -> Array:
        """Where a thing starts in the shut drawer: m behind its front, aside, above its floor."""
        floor = self.chest.height_of(self.level) - 0.5 * self.chest.pitch + FLOOR
        return self.chest.frame(behind_front - self.chest.depth / 2, aside, floor + above)


@dataclass
class Chest(Asset):
    """Three drawers in a wooden frame. Its frame is the middle of its foot, x into the chest."""

    scale: float = 1.0
    open_level: str | None = None  # which drawer is open at the start
    interlocked = True
    radius = 0.26

    def __post_init__(self) -> None:
        self.width, self.depth = WIDTH * self.scale, DEPTH * self.scale
        self.pitch, self.plinth = PITCH * self.scale, PLINTH * self.scale
        self.height = self.plinth + 3 * self.pitch + WALL
        self.links = (Link("frame", self._frame_shapes()), *map(self._drawer, LEVELS))

    def __getitem__(self, level: str) -> Drawer:
        return Drawer(self, level)

    def drawers(self) -> Iterator[Drawer]:
        """The drawers from top to bottom."""
        return (Drawer(self, level) for level in LEVELS)

    def height_of(self, level: str) -> float:
        """The height of a drawer's middle above the chest's foot, m."""
        return self.plinth + (2.5 - LEVELS.index(level)) * self.pitch

    def handle_offset(self, level: str) -> Array:
        """A handle's middle in the frame of its drawer's link."""
        return pose(-self.depth / 2 - REACH, 0, self.height_of(level))

    def _frame_shapes(self) -> tuple[Shape, ...]:
        w, d, h = self.width, self.depth, self.height
        dark = shade(WOOD, 0.8)
        walls, middle = h - self.plinth - WALL, (h + self.plinth - WALL) / 2
        return (
            box((d, w, self.plinth), (0, 0, self.plinth / 2), dark, bevel=0.004),
            box((d + LEDGE, w, WALL), (-LEDGE / 2, 0, h - WALL / 2), WOOD, bevel=0.002),
            *(
                box(
                    (d - WALL, w - 2 * WALL, SHELF),
                    (-WALL / 2, 0, self.plinth + k * self.pitch),
                    dark,
                )
                for k in (1, 2)
            ),
            box((WALL, w, walls), ((d - WALL) / 2, 0, middle), dark),
            *(
                box(
                    (d - WALL, WALL, walls),
                    (-WALL / 2, side * (w - WALL) / 2, middle),
                    WOOD,
                    bevel=0.002,
                )
                for side in (-1, 1)
            ),
        )

    def _drawer(self, level: str) -> Link:
        travel = TRAVEL if self.scale == 1.0 else TRAVEL * min(1.0, self.scale / 0.7)
        start = travel if level == self.open_level else 0.0
        joint = Joint("slide", (-1, 0, 0), 0.0, travel, friction=3.0, detent=DETENT, start=start)
        shapes = (*self._tray(level), *self._handle(level))
        return Link(level, shapes, mass=0.8, joint=joint, graspable=True, friction=1.0)

    def _tray(self, level: str) -> tuple[Shape, ...]:
        inner, deep = self.width - 2 * WALL - 0.004, self.depth - WALL - 0.006
        middle, front = self.height_of(level), -self.depth / 2
        low = middle - 0.5 * self.pitch + SHELF
        wall, pale = 0.5 * self.pitch, shade(WOOD, 1.25)
        center = front + deep / 2
        face = (0.016, self.width - 0.004, self.pitch - 0.004)
        return (
            box(face, (front - 0.008, 0, middle), shade(WOOD, 1.12), bevel=0.003),
            box((deep, inner, 0.01), (center, 0, low + 0.005), pale),
            box((0.008, inner, wall), (front + deep - 0.004, 0, low + wall / 2), pale),
            *(
                box((deep, 0.008, wall), (center, side * (inner - 0.008) / 2, low + wall / 2), pale)
                for side in (-1, 1)
            ),
        )

    def _handle(self, level: str) -> tuple[Shape, ...]:
        x, z = -self.depth / 2 - REACH, self.height_of(level)
        length = 0.56 * self.pitch
        along_x = (0.0, 0.7071067811865476, 0.0, 0.7071067811865476)
        foot = REACH - 0.016
        return (
            cylinder(BAR, length, (x, 0, z), METAL, bevel=0.002),
            *(
                cylinder(
                    0.005,
                    foot,
                    (x + foot / 2, 0, z + side * (length / 2 - 0.007)),
                    METAL,
                    rotation=along_x,
                )
                for side in (-1, 1)
            ),
        )
