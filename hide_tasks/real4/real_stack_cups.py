"""Put two, three or four of the cups around it into the middle cup.

HIDE appendix, real-world task (b), seen by one external camera. The paper's description lists the
keyframes of three counts (11, 17 or 23: six for each of two, three or four cups, the last rise
left out); its table says four variations and no more about them. The description is followed.
It leaves open how many cups stand around: four, five or six here, so that those that are left do
not tell how many were stacked, and one in another hardly stands out.
"""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from hide_tasks.assets.cup import Cup
from hide_tasks.assets.paper_cup import PaperCup
from hide_tasks.contract import Failure, HiddenState, Value
from hide_tasks.motion.cups import freest_side, rim_move
from hide_tasks.poses import Array
from hide_tasks.task import Alias, Checks, Grid, Moment, Stage
from hide_tasks.tasks.stack_cups_new import StackCupsNew

AROUND = (4, 5, 6)  # cups around the middle one
MOST = AROUND[-1]  # places for them
MIDDLE, AWAY = (0.24, 0.0), 0.02  # m; how far off, either way
RADIUS = (0.175, 0.19)  # m from the middle cup's axis to another's
TURN, ASKEW = 0.3, 0.04  # rad, either way: of all places together, of each
HOVER, LIFT, ABOVE = 0.08, 0.17, 0.13  # m; ABOVE the highest place in the stack
DROP = 0.008  # m over the highest place: every cup is let go from there
RAISED = 0.004  # m over its place on the table at which a cup is no longer standing alone
NUMBERS = ("first", "second", "third", "fourth")


class RealStackCups(StackCupsNew):
    instructions = ("stack {count} cups on the middle cup",)
    variations = Grid(count=(2, 3, 4))
    histories = Grid(around=AROUND)
    looks = ()
    keyframes = frozenset({11, 17, 23})
    cameras: ClassVar = ("front",)
    remembers = "how many cups are stacked"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one cup more than asked for",
        Failure.UNDERCOUNT: "fewer cups than asked for",
        Failure.UNFINISHED: "the hand still holds a cup",
        Failure.WRONG_OBJECT: "a cup was put into another than the middle one",
        Failure.DROPPED_OBJECT: "a cup fell off the table",
    }

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return variation

    def build(self) -> None:
        between = self.layout.between
        x, y = (at + between(-AWAY, AWAY) for at in MIDDLE)
        self.base = self._stand(PaperCup(fixed=True), x, y)
        turn = between(-TURN, TURN)
        angles = [turn + between(-ASKEW, ASKEW) + k * math.tau / MOST for k in range(MOST)]
        rays = [between(*RADIUS) * np.array([math.cos(a), math.sin(a)]) for a in angles]
        from_left = sorted(rays, key=lambda ray: -float(ray[1]))
        missing = MOST - self.variation.around
        cups = [
            self._stand(PaperCup(there=number >= missing), x + east, y + north)
            for number, (east, north) in enumerate(from_left)
        ]
        self.others = cups[missing:]
        self.wanted = self.variation.count
        for number, cup in enumerate(self.others):
            self.count(f"cup_{number + 1}_stacking", partial(self._sits, cup), up=0.5, down=0.5)
        self.wrong = self.count("wrong_stacking", self._astray, up=0.5, down=0.5)

    def _stand(self, cup: PaperCup, x: float, y: float) -> PaperCup:
        cup = self.layout.add(cup, x, y)
        cup.at[2] += cup.height / 2
        return cup

    def _astray(self) -> float:
        """1.0 while one of the raised cups is in another than the middle one."""
        raised = [cup for cup in self.others if cup.position[2] > cup.at[2] + RAISED]
        return float(
            any(
                self._nested(cup, other) and not self._nested(cup, self.base)
                for cup in raised
                for other in self.others
                if other is not cup
            )
        )

    def hidden_state(self) -> HiddenState:
        return {"stacked": self.stacked}

    def stage(self) -> str:
        done = self.stacked
        return f"stack {NUMBERS[done]}" if done < self.wanted else "done"

    def expert(self) -> Iterator[Stage]:
        goal = self._top()
        for number, cup in enumerate(self.others[: self.wanted]):
            here = np.array(cup.position)
            alone = [np.array(other.position) for other in self.others[number + 1 :]]
            side = freest_side(cup, goal, alone)
            moves = (
                rim_move(here, cup, side, HOVER, opened=True),
                rim_move(here, cup, side, 0.0, opened=False, touching=True),
                rim_move(here, cup, side, LIFT, opened=False),
                rim_move(goal, cup, side, ABOVE, opened=False),
                rim_move(goal, cup, side, DROP, opened=True, touching=True),
                rim_move(goal, cup, side, ABOVE, opened=True),
            )
            last = number + 1 == self.wanted
            yield Stage(f"stack {NUMBERS[number]}", *(moves[:-1] if last else moves))

    def _top(self) -> Array:
        """The middle of a fourth cup in the stack, where every cup is let go."""
        x, y, z = self.base.position
        return np.array([x, y, z + len(NUMBERS) * self.base.floor])

    def checks(self) -> Checks:
        return {
            "stacked_exactly": self.stacked == self.wanted,
            "gripper_empty": not self._holding(),
        }

    def _holding(self) -> bool:
        cups: list[Cup] = [self.base, *self.others]
        return any(map(self.robot.holds, cups))

    def missing(self) -> Failure:
        held = self._holding() and self.stacked >= self.wanted
        return Failure.UNFINISHED if held else Failure.UNDERCOUNT

    def aliases(self) -> list[Alias]:
        """The last cup over the stack, and the one before it where a cup fewer stood around."""
        before = 6 * (self.wanted - 1)
        return [
            Alias(
                Moment(before + 4, {"around": around + 1}),
                Moment(before - 2, {"around": around}),
                f"a cup over the stack and {left} around, after {self.wanted - 1} and one fewer",
            )
            for around in AROUND[:-1]
            for left in (around + 1 - self.wanted,)
        ]
