"""Put one or two of the other cups into the cup of the named colour.

HIDE appendix A.1 (d), as the paper has it: of three cups those that still stand alone tell how
many are stacked, so memory is hardly needed.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import permutations
from typing import ClassVar

import numpy as np

from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.cup import Cup
from hide_tasks.contract import Category, Failure, HiddenState, Value
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.cups import freest_side, rim_move
from hide_tasks.poses import Array
from hide_tasks.task import Alias, Checks, Grid, Stage, Task

NAMES = tuple(COLORS)
CUPS = 3
NTH = ("first", "second", "third")
AREA = Area(x=(0.10, 0.42), y=(-0.26, 0.26))
GAP = 0.06  # m between two cups' rims: room for a finger
HOVER, LIFT, ABOVE, RISE = 0.08, 0.17, 0.14, 0.20  # m
DROP = 0.008  # m over its place at which a cup is let go
ASIDE = 0.02  # m of a nested cup's axis from the base's
HIGHEST = 0.08  # m of a nested cup above the base
WITHDRAWN = 0.25  # m of the tip above the table
FELL = 0.1  # m under the table's top


class StackCupsNew(Task):
    category = Category.REPETITION_COUNTING
    instructions: ClassVar[tuple[str, ...]] = (
        "stack {cups} on top of the {color} cup",
        "place {number} of the other cups onto the {color} cup",
        "leave the {color} cup where it is and stack {cups} on it",
    )
    variations = Grid(color=NAMES, number=("one", "two"))
    looks: ClassVar[tuple[str, ...]] = ("color",)
    keyframes = frozenset({6, 11})
    remembers = "how many cups are stacked; the cups that stand alone tell it"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one cup more than asked for",
        Failure.UNDERCOUNT: "fewer cups than asked for",
        Failure.UNFINISHED: "the hand still holds a cup",
        Failure.NOT_WITHDRAWN: "the arm stayed at the stack",
        Failure.WRONG_OBJECT: "a cup was put into another than the named one",
        Failure.DROPPED_OBJECT: "a cup fell off the table",
    }
    spoils = frozenset({Failure.OVERCOUNT})
    withdrawn = WITHDRAWN

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        """Also the number as the paper's "cup(s)"."""
        cups = {"one": "one cup", "two": "two cups"}[str(variation["number"])]
        return {**variation, "cups": cups}

    def build(self) -> None:
        order = [NAMES[i] for i in self.layout.rng.permutation(len(NAMES))]
        others = [name for name in order if name != self.variation.color][: CUPS - 1]
        cups = [Cup(name) for name in (self.variation.color, *others)]
        self.layout.scatter(cups, AREA, gap=GAP)
        for cup in cups:
            cup.at[2] += cup.height / 2
        self.base: Cup = cups[0]
        self.others: Sequence[Cup] = cups[1:]
        self.wanted = ("one", "two").index(str(self.variation.number)) + 1
        for cup in self.others:
            self.count(f"{cup.color}_stacking", partial(self._sits, cup), up=0.5, down=0.5)
        self.wrong = self.count("wrong_stacking", self._astray, up=0.5, down=0.5)

    def _sits(self, cup: Cup) -> float:
        return float(self._nested(cup, self.base))

    def _astray(self) -> float:
        return float(
            any(
                self._nested(cup, other) and not self._nested(cup, self.base)
                for cup, other in permutations(self._cups(), 2)
            )
        )

    def _cups(self) -> tuple[Cup, ...]:
        return (self.base, *self.others)

    def _nested(self, cup: Cup, base: Cup) -> bool:
        x, y, z = (p - q for p, q in zip(cup.position, base.position, strict=True))
        near = abs(x) < ASIDE and abs(y) < ASIDE and 0.0 < z < HIGHEST
        return near and not self.robot.holds(cup)

    @property
    def stacked(self) -> int:
        """How many cups are in the base now."""
        return sum(self._nested(cup, self.base) for cup in self.others)

    def hidden_state(self) -> HiddenState:
        return {"stacked": self.stacked}

    def stage(self) -> str:
        done = self.stacked
        return "withdraw" if done >= self.wanted else self._name(done)

    def expert(self) -> Iterator[Stage]:
        order = self._order()
        for number, cup in enumerate(order[: self.wanted]):
            here, goal = np.array(cup.position), self._place(number)
            alone = [np.array(other.position) for other in order[number + 1 :]]
            side = freest_side(cup, goal, alone)
            yield Stage(
                self._name(number),
                rim_move(here, cup, side, HOVER, opened=True),
                rim_move(here, cup, side, 0.0, opened=False, touching=True),
                rim_move(here, cup, side, LIFT, opened=False),
                rim_move(goal, cup, side, ABOVE, opened=False),
                rim_move(goal, cup, side, DROP, opened=True, touching=True),
            )
        yield Stage("withdraw", rim_move(goal, cup, side, RISE, opened=True))

    def _name(self, done: int) -> str:
        """The stage after so many cups."""
        return f"stack {NTH[done]}"

    def _order(self) -> list[Cup]:
        """The nearest first."""
        base = np.array(self.base.position)
        return sorted(self.others, key=lambda c: float(np.linalg.norm(c.position - base)))

    def _place(self, number: int) -> Array:
        """The middle of the next cup when it is nested."""
        x, y, z = self.base.position
        return np.array([x, y, z + (number + 1) * self.base.floor])

    def checks(self) -> Checks:
        return {
            "stacked_exactly": self.stacked == self.wanted,
            "gripper_empty": not any(map(self.robot.holds, self._cups())),
            "arm_withdrawn": self.robot.tip_height > self.withdrawn,
        }

    def missing(self) -> Failure:
        if self.stacked < self.wanted:
            return Failure.UNDERCOUNT
        held = any(map(self.robot.holds, self._cups()))
        return Failure.UNFINISHED if held else Failure.NOT_WITHDRAWN

    def violations(self) -> list[Failure]:
        over = self.stacked > self.wanted
        fell = any(cup.position[2] < TABLE_TOP - FELL for cup in self._cups())
        return (
            [Failure.OVERCOUNT] * over
            + [Failure.WRONG_OBJECT] * (self.wrong.total > 0)
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        return []
