"""Spring-loaded dispensers: what is put on top sinks in, so that the top always looks the same.

Like a cafeteria's for plates: let into the table, it holds a pile of equal things.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from hide_tasks.assets.asset import Asset, Link, Shape, box, shade
from hide_tasks.assets.colors import COLORS, RGB
from hide_tasks.poses import Array, pose, quaternion

SPEED = 0.0012  # m per physics step that the pile moves: 0.29 m/s
ASIDE, OVER = 0.02, 0.015  # m from where it would stand that a thing may be let go
UNDER_TABLE = 0.10  # m under the table's top that the buried ones begin
SHAFT = 0.44  # m under the table that it reaches
STEEL: RGB = (176, 182, 188)


@dataclass
class Dispenser(Asset):
    """Holds a pile of equal things; its frame is its foot's middle.

    What is let go on top of the pile joins it and sinks by `pitch`. When the top one is taken
    away, the next comes up.
    """

    things: Sequence[Asset]
    level: float  # m of the top thing's middle above the foot
    pitch: float  # m that a thing stands above the one below it
    pile: list[int] = field(init=False, default_factory=list)  # numbers of things, top last
    lift: float = field(init=False, default=0.0)  # m of the top one above its place
    _kept: list[Array] = field(init=False, default_factory=list)  # where those of the pile are

    def store(self, number: int) -> None:
        """Begin with the numbered thing on top of what is inside."""
        self.pile.append(number)
        for number, at in zip(self.pile, self._places(), strict=True):
            self.things[number].at = at

    def holds(self, thing: Asset) -> bool:
        """True when a thing is in the pile."""
        return any(self.things[number] is thing for number in self.pile)

    @property
    def at_rest(self) -> bool:
        """False while the pile moves."""
        return self.lift == 0.0 or self._in_the_way()

    def act(self) -> None:
        """Let the top one go, take in what was put on it, move, keep all where they are."""
        before = len(self.pile), self.lift
        if self.pile and self.things[self.pile[-1]].body.held():
            self.pile.pop()
            self.lift -= self.pitch
        elif self.lift <= 0.0:
            self._take_in()
        self._move()
        if (len(self.pile), self.lift) != before or not self._kept:
            self._kept = self._places()
        for number, at in zip(self.pile, self._kept, strict=True):
            self.things[number].body.place(at)

    def _move(self) -> None:
        if self.lift > 0.0:
            self.lift = max(self.lift - SPEED, 0.0)
        elif self.lift < 0.0 and not self._in_the_way():
            self.lift = min(self.lift + SPEED, 0.0)

    def _take_in(self) -> None:
        for number, thing in enumerate(self.things):
            free = number not in self.pile and not thing.body.held()
            if free and self._on_top(thing.position):
                self.pile.append(number)
                self.lift += self.pitch
                return

    def _on_top(self, position: Sequence[float]) -> bool:
        x, y, z = (p - q for p, q in zip(position, self._at(self.top + self.pitch), strict=True))
        return abs(z) <= OVER and max(abs(x), abs(y)) <= ASIDE

    def _in_the_way(self) -> bool:
        """True while what was taken off is still where the next would come up."""
        x, y, z = self._at(self.level + self.pitch)
        return any(
            max(abs(p[0] - x), abs(p[1] - y)) < self.radius and p[2] < z
            for number, thing in enumerate(self.things)
            if number not in self.pile and (p := thing.position)
        )

    @property
    def top(self) -> float:
        """The middle of the top thing, m above the foot."""
        return self.level + self.lift

    @cached_property
    def _foot(self) -> tuple[float, float, float]:
        x, y, z = self.at[:3].tolist()
        return x, y, z

    def _at(self, height: float) -> tuple[float, float, float]:
        x, y, z = self._foot
        return x, y, z + height

    def _places(self) -> list[Array]:
        """Where those of the pile are: two in the collar, the others under the table."""
        buried = [-UNDER_TABLE - n * self.pitch for n in range(len(self.pile) - 2)][::-1]
        heights = [*buried, self.top - self.pitch, self.top]
        return [pose(*self._at(height)) for height in heights[len(heights) - len(self.pile) :]]


@dataclass
class BlockDispenser(Dispenser):
    """A square collar with a block on top."""

    size: float = 0.05  # m of a block
    radius = 0.05

    def __post_init__(self) -> None:
        hole, wall = self.size + 0.006, 0.010
        high, off = self.level - 0.45 * self.size, (hole + wall) / 2
        collar = (
            *(box((hole + 2 * wall, wall, high), (0, y, high / 2), STEEL) for y in (-off, off)),
            *(box((wall, hole, high), (x, 0, high / 2), STEEL) for x in (-off, off)),
        )
        foot = box((0.13, 0.13, 0.006), (0, 0, 0.003), shade(STEEL, 0.75), solid=False)
        shaft = box((0.10, 0.10, SHAFT), (0, 0, -0.04 - SHAFT / 2), shade(STEEL, 0.6), solid=False)
        self.links = (Link("dispenser", (*collar, foot, shaft)),)


FOOT, RIM, HOLLOW = 0.054, 0.058, 0.0495  # m, radii of the tall cup, outer and inner
LOWER = 0.020  # m of its rim under that of the cup in it
STAVES = 12  # boxes round the hollow


@dataclass
class CupDispenser(Dispenser):
    """A tall cup with a spring floor; another cup stands in it. It is fixed to the table."""

    color: str = "red"
    height: float = 0.10  # m of the cups in it
    radius = 0.06

    def __post_init__(self) -> None:
        high, color = self.rim, COLORS[self.color]
        line = ((0.0, 0.0), (FOOT, 0.0), (RIM, high), (HOLLOW, high), (HOLLOW, 0.02), (0.0, 0.02))
        seen = Shape("lathe", tuple(v for p in line for v in p), color, solid=False)
        shaft = box((0.10, 0.10, SHAFT), (0, 0, -0.04 - SHAFT / 2), shade(STEEL, 0.6), solid=False)
        self.links = (Link("dispenser", (seen, shaft, *map(self._stave, range(STAVES)))),)

    @property
    def rim(self) -> float:
        """Its upper edge above the foot, m."""
        return self.level + self.height / 2 - LOWER

    def _stave(self, number: int) -> Shape:
        turn, thick = 2 * math.pi * number / STAVES, FOOT - HOLLOW
        away, wide = HOLLOW + thick / 2, 2 * FOOT * math.tan(math.pi / STAVES)
        place = (away * math.cos(turn), away * math.sin(turn), self.rim / 2)
        at = (*place, *quaternion(yaw=turn).tolist())
        return Shape("box", (thick, wide, self.rim), COLORS[self.color], at=at, seen=False)
