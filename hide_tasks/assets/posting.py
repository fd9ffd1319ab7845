"""Closed holders with a flap: what falls in is out of sight, and nothing shows how much that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from hide_tasks.assets.asset import Asset, Link, Shape, box, shade
from hide_tasks.assets.colors import RGB
from hide_tasks.assets.container import FLOOR, WALL, Container
from hide_tasks.assets.rubbish import BIN_HEIGHT, BIN_SIDE, BIN_WALL, Bin
from hide_tasks.assets.rubbish import HEIGHT as PAPER_HEIGHT
from hide_tasks.assets.rubbish import WIDTH as PAPER_WIDTH
from hide_tasks.poses import Array

RUBBER: RGB = (34, 34, 38)
LINE: RGB = (12, 12, 14)
FLAP = 0.002  # m, thick: seen, not felt
SLIT = 0.004  # m between the flap's halves


def flap(length: float, width: float, height: float) -> tuple[Shape, ...]:
    """A rubber sheet with a slit; its lower side is at a height."""
    middle = height + FLAP / 2
    return (
        box((length, width, FLAP), (0, 0, middle), RUBBER, solid=False),
        box((length, SLIT, FLAP), (0, 0, middle + 0.0005), LINE, solid=False),
    )


class Swallowing(Asset):
    """Takes in what is let go and falls in: everything has a place of its own in there.

    So what is inside lies the same way, whenever it came there and in which order.
    """

    things: Sequence[Asset]

    def swallows(self, position: Sequence[float]) -> bool:
        """True when a thing there, its middle at a point of the world, is wholly inside."""
        raise NotImplementedError

    def place_of(self, number: int) -> Array:
        """Where the numbered thing lies once it is in, pose (7,)."""
        raise NotImplementedError

    @cached_property
    def places(self) -> list[Array]:
        """Where each thing lies once it is in; asked for when the holder stands."""
        return [self.place_of(number) for number in range(len(self.things))]

    def store(self, number: int) -> None:
        """Begin with the numbered thing inside."""
        self.things[number].at = self.places[number]

    def act(self) -> None:
        """Put every thing that is inside to its place."""
        for thing, place in zip(self.things, self.places, strict=True):
            if self.swallows(thing.position) and not thing.body.held():
                thing.body.place(place)


ROWS = 3  # of places, and as many in a row
PITCH = 0.053  # m from place to place
OPENING = 0.07  # m, square: a little larger than a block
SUNK = 0.010  # m of the flap under the top
LIP = 0.006  # m of the frame around the opening


@dataclass(kw_only=True)
class PostingBox(Container, Swallowing):
    """A closed box with a flap in its top, for blocks of one size."""

    things: Sequence[Asset]
    size: float  # m of a block
    inside: float = 0.164  # m, either way
    depth: float = 0.126  # m

    def __post_init__(self) -> None:
        high, off = self.rim - WALL, (self.inside + WALL) / 2
        long = self.inside + 2 * WALL
        walls = (
            *(box((long, WALL, high), (0, y, high / 2), self.color) for y in (-off, off)),
            *(box((WALL, self.inside, high), (x, 0, high / 2), self.color) for x in (-off, off)),
        )
        floor = box((self.inside, self.inside, FLOOR), (0, 0, FLOOR / 2), self.color)
        closed = flap(OPENING, OPENING, self.rim - SUNK)
        self.links = (Link("box", (*walls, floor, *self._top(long), *closed)),)

    def _top(self, long: float) -> tuple[Shape, ...]:
        """The top around the opening, and the opening's frame."""
        light, broad = shade(self.color, 1.2), (long - OPENING) / 2
        off, level = (OPENING + broad) / 2, self.rim - WALL / 2
        around = (
            *(box((broad, long, WALL), (x, 0, level), light) for x in (-off, off)),
            *(box((OPENING, broad, WALL), (0, y, level), light) for y in (-off, off)),
        )
        edge = (OPENING + LIP) / 2
        sides = {True: (LIP, OPENING + 2 * LIP, 0.001), False: (OPENING, LIP, 0.001)}
        frame = (
            box(
                sides[lengthwise],
                (end * edge * lengthwise, end * edge * (not lengthwise), self.rim),
                (235, 225, 200),
                solid=False,
            )
            for end in (-1, 1)
            for lengthwise in (True, False)
        )
        return (*around, *frame)

    def contains(self, position: Sequence[float]) -> bool:
        """True when a point of the world is within the walls and under the flap."""
        x, y, z = (float(p - q) for p, q in zip(position, self.at[:3], strict=True))
        return max(abs(x), abs(y)) <= self.inside / 2 and 0.0 <= z <= self.rim - SUNK

    def swallows(self, position: Sequence[float]) -> bool:
        """True when a block there is wholly under the flap."""
        under = position[2] - float(self.at[2]) <= self.rim - SUNK - self.size / 2
        return under and self.contains(position)

    def place_of(self, number: int) -> Array:
        """One of the places on its floor."""
        x, y = ((n - (ROWS - 1) / 2) * PITCH for n in divmod(number, ROWS))
        return self.frame(x, y, FLOOR + self.size / 2 + 0.0005)


@dataclass
class FlapBin(Bin, Swallowing):
    """A bin with a flap under its rim."""

    things: Sequence[Asset]

    def __post_init__(self) -> None:
        super().__post_init__()
        (base,) = self.links
        side = BIN_SIDE - 2 * BIN_WALL
        closed = flap(side, side, BIN_HEIGHT - SUNK)
        self.links = (replace(base, shapes=(*base.shapes, *closed)),)

    def swallows(self, position: Sequence[float]) -> bool:
        """True when a crumpled sheet there is wholly under the flap."""
        under = position[2] - float(self.at[2]) <= BIN_HEIGHT - SUNK - PAPER_WIDTH / 2
        return under and self.contains(position)

    def place_of(self, number: int) -> Array:
        """The middle of its floor."""
        return self.frame(0.0, 0.0, BIN_WALL + PAPER_HEIGHT / 2 + 0.0005)
