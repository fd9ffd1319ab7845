"""Pour the liquid into the other cup, then put the cup on the coaster where it did not stand.

HIDE appendix A.1 (g). Both coasters are alike and the cup is emptied in one pose: once it is
empty, nothing shows on which coaster it stood.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from hide_tasks.assets.coaster import HEIGHT, Coaster
from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.cup import Cup
from hide_tasks.assets.liquid import Droplet, Level, filling
from hide_tasks.assets.seat import Seat
from hide_tasks.contract import Category, Failure, HiddenState, Value
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import move
from hide_tasks.motion.pouring import LIFT, STANDOFF, Pouring, pouring_for
from hide_tasks.poses import Array, pose
from hide_tasks.task import Alias, Checks, Grid, Moment, Move, Stage, Task

NAMES = tuple(COLORS)
SIDES = ("left", "right")  # of the coasters, as the robot sees them
COASTERS_AT = {"left": (0.27, 0.19), "right": (0.27, -0.19)}  # m
TARGET_AT = (0.34, 0.0)  # m
JITTER = 0.02  # m, either way
DROPLETS = 12
SPREAD = 0.001  # m, either way
SPILLED = 0.02  # m above the table: lower, a droplet in no cup is spilled


class PourPutBack(Task):
    category = Category.HISTORICAL_STATE_RECALL
    instructions = (
        "pour liquid from the {color} cup to the {target} cup, then place it on the other coaster",
        "empty the {color} cup into the {target} cup and put it on the coaster it was not on",
        "pour the {color} cup into the {target} cup, then set it down on the other coaster",
    )
    variations = Grid(color=NAMES, origin=SIDES)
    looks = ("color",)
    keyframes = frozenset({6, 7, 8})
    remembers = "on which coaster the cup stood"
    failures: ClassVar = {
        Failure.WRONG_RECALL: "the emptied cup went back to its own coaster",
        Failure.SKIPPED_STEP: "the cup was put on the other coaster before it was emptied",
        Failure.WRONG_OBJECT: "the other cup was taken",
        Failure.UNFINISHED: "the liquid was not poured",
        Failure.NOT_PLACED: "the emptied cup is on no coaster",
        Failure.DROPPED_OBJECT: "liquid was spilled",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return {**variation, "target": _next_color(str(variation["color"]))}

    def build(self) -> None:
        color = str(self.variation.color)
        self.coasters = {
            side: self.layout.add(Coaster(), *self._near(at)) for side, at in COASTERS_AT.items()
        }
        self.goal = next(side for side in SIDES if side != self.variation.origin)
        self.source = self.layout.add_at(_source(color), self._place(self.variation.origin))
        x, y = self._near(TARGET_AT)
        self.target = self.layout.add(_target(_next_color(color)), x, y)
        self.target.at[2] += self.target.height / 2
        for side in SIDES:
            stands = side == self.variation.origin
            self.layout.seat(Seat(self.source, self._place(side), firm=True, taken=stands))
        # Else the droplets would shift it by what tells from where they came.
        self.layout.seat(Seat(self.target, self.target.at, firm=True, taken=True))
        self._fill()
        self._count()

    def _near(self, at: tuple[float, float]) -> tuple[float, float]:
        x, y = (value + self.layout.between(-JITTER, JITTER) for value in at)
        return x, y

    def _place(self, side: str) -> Array:
        """The pose of the cup on a coaster."""
        x, y, z = self.coasters[side].at[:3].tolist()
        return pose(x, y, z + HEIGHT + _source("red").height / 2)

    def _fill(self) -> None:
        spread = self.layout.rng.uniform(-SPREAD, SPREAD, (DROPLETS, 2))
        cups = (self.source, self.target)
        self.droplets = [
            self.layout.add_at(Droplet(cups), at) for at in filling(self.source, spread)
        ]
        for cup in cups:
            self.layout.add_at(Level(cup, self.droplets), self.target.at)

    def _count(self) -> None:
        self.poured = 0  # droplets in the target, as last counted
        self.pourings = self.count("pouring", self._pour, up=DROPLETS - 0.5, down=1)
        self.returns = self.count(
            "return",
            lambda: float(self._stands_on(self.variation.origin)),
            up=0.5,
            down=0.5,
            when=lambda: self.pourings.total > 0,
        )
        self.early = self.count(
            "early",
            lambda: float(self._stands_on(self.goal)),
            up=0.5,
            down=0.5,
            when=lambda: self.pourings.total == 0,
        )

        self.wrong = self.count(
            "other_cup", lambda: float(self.robot.holds(self.target)), up=0.5, down=0.5
        )

    def _pour(self) -> float:
        left = [d.position for d in self.droplets if not self.source.holds(d.position)]
        self.poured = self.target.standing_holds(left)
        return self.poured

    def _stands_on(self, side: str) -> bool:
        coaster, cup = self.coasters[side], self.source
        return not self.robot.holds(cup) and coaster.carries(cup.position, cup.height)

    def hidden_state(self) -> HiddenState:
        return {"origin": self.variation.origin, "poured": self.pourings.total > 0}

    def stage(self) -> str:
        return f"to {self.goal}" if self.pourings.total else "pour"

    def expert(self) -> Iterator[Stage]:
        start, goal = (self._place(side)[:3] for side in (self.variation.origin, self.goal))
        places = [self._place(side)[:3] for side in SIDES]
        way = pouring_for(self.robot, self.source, self.target, places[0], places[1])
        yield Stage(
            "pour",
            move(lambda: way.held(start, back=STANDOFF)),
            move(lambda: way.held(start), opened=False, touching=True),
            move(lambda: way.held(start, up=LIFT), opened=False),
            *_pour(way),
        )
        yield Stage(
            f"to {self.goal}",
            move(lambda: way.held(goal, up=LIFT), opened=False),
            move(lambda: way.held(goal), touching=True),
        )

    def checks(self) -> Checks:
        return {
            "liquid_in_target": self.poured == DROPLETS,
            "cup_on_other_coaster": self._stands_on(self.goal),
        }

    def missing(self) -> Failure:
        return Failure.NOT_PLACED if self.pourings.total else Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        return (
            [Failure.WRONG_RECALL] * (self.returns.total > 0)
            + [Failure.SKIPPED_STEP] * (self.early.total > 0)
            + [Failure.WRONG_OBJECT] * (self.wrong.total > 0)
            + [Failure.DROPPED_OBJECT] * any(map(self._spilled, self.droplets))
        )

    def _spilled(self, droplet: Droplet) -> bool:
        place = droplet.position
        low = place[2] < TABLE_TOP + SPILLED
        return low and not self.source.holds(place) and not self.target.holds(place)

    def aliases(self) -> list[Alias]:
        left, right = (Moment(6, {"origin": side}) for side in SIDES)
        return [Alias(left, right, "emptied; the cup stood on the left or on the right")]


def _pour(way: Pouring) -> tuple[Move, Move, Move]:
    poses = (way.ready, way.tipped, way.emptied)
    ready, tipped, emptied = (move(where, opened=False) for where in poses)
    return ready, tipped, emptied


def _next_color(color: str) -> str:
    return NAMES[(NAMES.index(color) + 1) % len(NAMES)]


def _source(color: str) -> Cup:
    return Cup(color, foot=0.028, rim=0.036, height=0.095, floor=0.008, wall=0.002, friction=0.6)


def _target(color: str) -> Cup:
    return Cup(
        color, foot=0.034, rim=0.046, height=0.08, floor=0.008, wall=0.002, mass=0.3, friction=0.6
    )
