"""Put exactly two or three of the other cups into the tall cup of the named colour.

`stack_cups_new` without its two leaks: the tall cup has a spring floor, so that what is put in
sinks and the top looks the same, and there are more cups than asked for, some inside from before.
"""

from collections.abc import Mapping
from itertools import permutations
from typing import ClassVar

from hide_tasks.assets.asset import Asset
from hide_tasks.assets.block_sets import other_than
from hide_tasks.assets.cup import Cup
from hide_tasks.assets.dispenser import CupDispenser
from hide_tasks.contract import Failure, Value
from hide_tasks.hard import TOLD_COLORS
from hide_tasks.layout import Area
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Grid, Moment
from hide_tasks.tasks.stack_cups_new import GAP, NAMES, NTH, StackCupsNew

NUMBERS = {"two": 2, "three": 3}  # one cup needs no memory: the hand is at the tall cup
EXTRAS = (0, 1, 2)
MOST = 3 + EXTRAS[-1]  # cups beside the one that is in the tall cup at any time
AREA = Area(x=(0.06, 0.44), y=(-0.32, 0.32))
LEVEL = 0.082  # m of the top cup's middle above the table
MOVES = 5  # keyframes of a cup


class StackCupsNewHard(StackCupsNew):
    instructions = (
        "stack {cups} on top of the {color} cup",
        "put {number} of the other cups into the tall {color} cup",
        "leave the {color} cup where it is and stack {cups} in it",
    )
    variations = Grid(color=TOLD_COLORS, number=tuple(NUMBERS))
    histories = Grid(extra=EXTRAS)
    keyframes = frozenset({11, 16})
    withdrawn = 0.31  # m: no way from the tall cup to the next one is so high
    remembers = "how many cups were put into the tall one"
    failures: ClassVar = {
        **StackCupsNew.failures,
        Failure.WRONG_OBJECT: "a cup was put into another than the tall one",
    }

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return {**variation, "cups": f"{variation['number']} cups"}

    def build(self) -> None:
        named = self.variation.color
        other = other_than(named, [NAMES[i] for i in self.layout.rng.permutation(len(NAMES))])
        cups = [Cup(other) for _ in range(MOST + 1)]
        self.cups, pitch = cups, cups[0].floor
        self.dispenser = CupDispenser(cups, LEVEL, pitch, color=named, height=cups[0].height)
        things: list[Asset] = [self.dispenser, *cups[:MOST]]
        self.layout.scatter(things, AREA, gap=GAP)
        self.layout.add_at(cups[MOST], self.dispenser.at.copy())
        for cup in cups:
            cup.at[2] += cup.height / 2
        self.wanted = NUMBERS[str(self.variation.number)]
        loose = self.wanted + self.variation.extra
        for number in range(MOST, loose - 1, -1):
            self.dispenser.store(number)
        self.others = cups[:loose][::-1]  # the last is taken first: then the twin's are left
        self.layout.hold(self.others)
        self.wrong = self.count("wrong_stacking", self._astray, up=0.5, down=0.5)

    @property
    def stacked(self) -> int:
        """How many cups were put into the tall one."""
        return sum(map(self.dispenser.holds, self.others))

    def aliases(self) -> list[Alias]:
        return [self._alias(extra) for extra in EXTRAS[1:]]

    def _alias(self, extra: int) -> Alias:
        """All are stacked, or one is lacking where one more stood about at the start."""
        return Alias(
            Moment(MOVES * self.wanted, {"extra": extra}),
            Moment(MOVES * (self.wanted - 1), {"extra": extra - 1}),
            f"at the tall cup, all are stacked or one is lacking; {extra} stand about",
        )

    def _name(self, done: int) -> str:
        """A stage is told by what is to be seen then: how many stood about, and which this is."""
        return f"stack {NTH[done]} of {len(self.others)}"

    def _order(self) -> list[Cup]:
        return list(self.others)

    def _place(self, number: int) -> Array:
        """Where every cup is put: into the top one."""
        return point(self.dispenser.at, 0, 0, LEVEL + self.dispenser.pitch)

    def _cups(self) -> tuple[Cup, ...]:
        """Those that are not in the tall one."""
        return tuple(cup for cup in self.cups if not self.dispenser.holds(cup))

    def _astray(self) -> float:
        return float(any(self._nested(*pair) for pair in permutations(self._cups(), 2)))
