"""Swap two rings between their pegs over the peg that is free.

HIDE appendix A.1 (o). Every arrangement of the rings is the start of one episode, on the way in
others and the end of one more, and the arm goes home after every move: only the history tells
which ring moves next, and that it is done.
"""

import itertools
import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.pegs import PEGS, PegBoard, SquareRing
from hide_tasks.assets.seat import Seat
from hide_tasks.contract import Category, Failure, HiddenState, Variation
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import home, over, put, take
from hide_tasks.poses import Array, yaw_of
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Move, Stage, Task

BOARD_X, BOARD_Y = (0.18, 0.36), (-0.12, 0.12)  # m
TURN = 0.3  # rad, at most, either way
GRIP = 0.004  # m of the tip above a ring's centre
ABOVE = 0.10  # m over a ring before it is grasped (RLBench)
LIFTED = 0.14  # m of a ring over its place: clear of the pegs
RELEASE = 0.003  # m of a ring over its place when it is let go
ON = 0.01  # m from its place: a ring is on the peg
FELL = 0.1  # m under the table's top
MOVES = 3
EACH = 6  # keyframes of a move
STARTS = tuple(f"{red} {blue}" for red, blue in itertools.permutations(PEGS, 2))


class SwapSquarePegs(Task):
    category = Category.EXECUTION_PROGRESS
    instructions = (
        "swap the positions of the two rings",
        "exchange the two square rings between their pegs",
        "put each square ring on the peg where the other one is",
    )
    variations = Grid(red_and_blue_on=STARTS)
    keyframes = frozenset({MOVES * EACH})
    remembers = "where each ring was at the start, and how many moves are done"
    failures: ClassVar = {
        Failure.WRONG_RECALL: "three moves, but the rings did not change places",
        Failure.REPEATED_STEP: "a fourth move",
        Failure.UNFINISHED: "fewer than three moves",
        Failure.NOT_PLACED: "a ring is on no peg",
        Failure.DROPPED_OBJECT: "a ring fell off the table",
    }
    # Three moves are enough. Whoever makes a fourth has lost the way.
    spoils = frozenset({Failure.DROPPED_OBJECT, Failure.REPEATED_STEP})

    def build(self) -> None:
        between = self.layout.between
        self.board = self.layout.add(
            PegBoard(), between(*BOARD_X), between(*BOARD_Y), yaw=between(-TURN, TURN)
        )
        self.places = {peg: self.board.place_on(peg)[:3].tolist() for peg in PEGS}
        self.start: list[str] = self.variation.red_and_blue_on.split()
        self.red, self.blue = self.rings = [
            self.layout.add_at(SquareRing(color), self.board.place_on(peg))
            for color, peg in zip(("red", "blue"), self.start, strict=True)
        ]
        self.peg_of = dict(zip(("red", "blue"), self.start, strict=True))  # where each was last
        self.first = self.red  # the ring that was moved first
        self.placings = [self._placings_of(ring) for ring in self.rings]
        for ring, start in zip(self.rings, self.start, strict=True):
            self._seat(ring, start)

    def _placings_of(self, ring: SquareRing) -> Counter:
        return self.count(
            f"{ring.color}_placing",
            lambda: float(self._peg_of(ring) is not None),
            up=0.5,
            down=0.5,
            when=lambda: self._moved(ring),
        )

    def _moved(self, ring: SquareRing) -> bool:
        """Whether a ring came to another peg than the one where it was; takes note of it."""
        peg = self._peg_of(ring)
        if peg is None or peg == self.peg_of[ring.color]:
            return False
        self.first = self.first if self.moves else ring
        self.peg_of[ring.color] = peg
        return True

    def _seat(self, ring: SquareRing, start: str) -> None:
        for peg in PEGS:
            at = self.board.place_on(peg)
            self.layout.seat(Seat(ring, at, firm=True, taken=peg == start))

    @property
    def moves(self) -> int:
        """How often a ring has been put on another peg."""
        return sum(counter.total for counter in self.placings)

    def hidden_state(self) -> HiddenState:
        red, blue = self.start
        return {"red_from": red, "blue_from": blue, "moves_done": self.moves}

    def stage(self) -> str:
        if self.moves >= MOVES:
            return self._swapped()
        second = self.rings[1 - self.rings.index(self.first)]
        return [stage.name for stage in self._swap(self.first, second)][self.moves]

    def expert(self) -> Iterator[Stage]:
        return self._swap(self.red, self.blue)

    def detours(self) -> list[Iterator[Stage]]:
        return [self._swap(self.blue, self.red)]

    def _swap(self, first: SquareRing, second: SquareRing) -> Iterator[Stage]:
        one, two, spare = self._origin(first), self._origin(second), self._spare()
        yield Stage(f"{first.color} from {one} to {spare}", *self._carry(one, spare), home())
        yield Stage(f"{second.color} from {two} to {one}", *self._carry(two, one), home())
        yield Stage(f"{first.color} from {spare} to {two}", *self._carry(spare, two))
        yield Stage(self._swapped(), home())

    def _carry(self, origin: str, goal: str) -> tuple[Move, ...]:
        yaw = yaw_of(self.board.at)
        a, b = self._grip(origin), self._grip(goal)
        return (
            over(lambda: a, ABOVE, opened=True, yaw=yaw),
            take(lambda: a, yaw=yaw),
            over(lambda: a, LIFTED, opened=False, yaw=yaw),
            over(lambda: b, LIFTED, opened=False, yaw=yaw),
            put(lambda: b + np.array([0, 0, RELEASE]), yaw=yaw),
        )

    def checks(self) -> Checks:
        return {
            **{
                f"{one.color}_on_the_other_peg": self._on(one, self._origin(other))
                for one, other in (self.rings, self.rings[::-1])
            },
            "gripper_empty": not any(map(self.robot.holds, self.rings)),
        }

    def missing(self) -> Failure:
        if any(self._peg_of(ring) is None for ring in self.rings):
            return Failure.NOT_PLACED
        return Failure.WRONG_RECALL if self.moves == MOVES else Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        again = self.moves > MOVES
        fell = any(ring.position[2] < TABLE_TOP - FELL for ring in self.rings)
        return [Failure.REPEATED_STEP] * again + [Failure.DROPPED_OBJECT] * fell

    def aliases(self) -> list[Alias]:
        red, blue, spare = *self.start, self._spare()
        return [
            Alias(
                Moment(EACH),
                Moment(0, _start(spare, blue)),
                "one move is done, or none and the rings began like that",
            ),
            Alias(
                Moment(2 * EACH),
                Moment(EACH, _start(blue, red)),
                "two moves are done, or one from another start",
            ),
            Alias(
                Moment(3 * EACH - 1),
                Moment(EACH - 1, _start(spare, red)),
                "the rings are swapped, or one move is done from another start",
            ),
        ]

    def _grip(self, peg: str) -> Array:
        x, y, z = self.places[peg]
        return np.array([x, y, z + GRIP])

    def _origin(self, ring: SquareRing) -> str:
        return self.start[self.rings.index(ring)]

    def _spare(self) -> str:
        return next(peg for peg in PEGS if peg not in self.start)

    def _on(self, ring: SquareRing, peg: str) -> bool:
        return math.dist(ring.position, self.places[peg]) < ON

    def _peg_of(self, ring: SquareRing) -> str | None:
        if self.robot.holds(ring):
            return None
        return next((peg for peg in PEGS if self._on(ring, peg)), None)

    def _swapped(self) -> str:
        red, blue = self.start
        return f"stop with red on {blue} and blue on {red}"


def _start(red: str, blue: str) -> Variation:
    return {"red_and_blue_on": f"{red} {blue}"}
