"""Open the sides of the cabinet one by one until the cup is found, then take it out.

HIDE appendix A.1 (m). A searched side is slid shut and the arm goes home: the scene looks like
the one at the start, so only the history tells which side comes next.
"""

import math
from collections.abc import Iterator

import numpy as np

from hide_tasks.assets.cabinet import SIDES, Cabinet, Door
from hide_tasks.assets.mug import HEIGHT, Mug
from hide_tasks.contract import Category, Failure, HiddenState, Variation
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.doors import (
    before,
    grasp_handle,
    look_behind,
    pitch_for,
    push_shut,
    slide_open,
)
from hide_tasks.motion.general import home, move, toward
from hide_tasks.poses import Array, compose, pose, quaternion
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

CABINET_AT = (0.57, 0.0)  # m
TURN = 0.1  # rad, at most, either way
SEEN = 0.12  # m: a door so far open shows what is behind it
SHUT = 0.01  # m
BEHIND = 0.04  # m of the cup behind the front: the palm stays outside
ASIDE = 0.025  # m of the cup outward from the middle of a side: room for the palm
SHORT = 0.008  # m of the tip before the cup's middle
OUT, LIFTED = 0.16, 0.02  # m that the cup is drawn out, and up
PITCHES = tuple(math.radians(angle) for angle in (15, 10, 20, 5, 30, 35))  # of the cup's grasp
BEFORE, ABOVE_TABLE = 0.24, 0.004  # m before where it stood and over the table: there it is let go
FELL = 0.1  # m under the table's top


class SearchCupFromCabinet(Task):
    category = Category.EXECUTION_PROGRESS
    instructions = (
        "take out a cup from the cabinet",
        "take a cup out of the cabinet",
        "find the cup in the cabinet and take it out",
    )
    variations = Grid(cup_on=SIDES)
    keyframes = frozenset({7, 8, 13, 14})
    remembers = "which sides have been searched"
    spoils = frozenset({Failure.DROPPED_OBJECT})

    def build(self) -> None:
        between = self.layout.between
        x, y = CABINET_AT
        self.cabinet = self.layout.add(
            Cabinet(),
            x + between(-0.02, 0.02),
            y + between(-0.03, 0.03),
            yaw=between(-TURN, TURN),
        )
        self.door = self.cabinet[self.variation.cup_on]
        aside, turn = between(-0.01, 0.01), between(-0.5, 0.5)
        foot = self.cabinet.shelf(
            self.door.side, behind=BEHIND, aside=self.door.outward * ASIDE + aside
        )
        standing = compose(foot, pose(0, 0, HEIGHT / 2 + 0.0005, quaternion(yaw=turn)))
        self.cup = self.layout.add_at(Mug("red"), standing)
        self.searches = {side: self._searches_of(self.cabinet[side]) for side in SIDES}

    def hidden_state(self) -> HiddenState:
        return {
            "cup_on": self.variation.cup_on,
            "searched": [side for side in SIDES if self.searches[side].total],
        }

    def stage(self) -> str:
        if self.robot.holds(self.cup) or not self.cabinet.contains(self.cup.position):
            return "take out"
        if self.door.opening > SEEN:
            return "take"
        opened = next((side for side in SIDES if self.cabinet[side].opening > SHUT), None)
        if opened:
            return f"close {opened}"
        left = [side for side in SIDES if not self.searches[side].total]
        return f"open {left[0] if left else self.door.side}"

    def expert(self) -> Iterator[Stage]:
        return self._search(SIDES)

    def detours(self) -> list[Iterator[Stage]]:
        # Shows what to do with either side when it is open and empty.
        return [self._search(SIDES[::-1])] if self.variation.cup_on == SIDES[0] else []

    def _search(self, order: tuple[str, ...]) -> Iterator[Stage]:
        for side in order:
            door = self.cabinet[side]
            pitch = pitch_for(self.robot, door)
            yield Stage(
                f"open {side}",
                before(door, pitch),
                grasp_handle(door, pitch),
                slide_open(door, pitch),
                look_behind(door, pitch),
            )
            if side == self.variation.cup_on:
                break
            yield Stage(f"close {side}", push_shut(door, pitch), home())
        pitch = self._pitch()
        yield Stage(
            "take",
            move(lambda: self._grip(pitch, back=0.10)),
            move(lambda: self._grip(pitch), opened=False, touching=True),
        )
        yield Stage(
            "take out",
            move(lambda: self._drawn_out(pitch), opened=False),
            move(lambda: self._set_down(pitch), touching=True),
        )

    def _pitch(self) -> float:
        """How far to tilt the tool, rad, so that the arm can follow the cup all the way."""
        chains = (
            [self._grip(p, back=0.10), self._grip(p), self._drawn_out(p), self._set_down(p)]
            for p in PITCHES
        )
        return PITCHES[self.robot.first_feasible(chains)]

    def _grip(self, pitch: float, *, back: float = 0.0, up: float = 0.0) -> Array:
        middle = np.concatenate([self.cup.position, self.cabinet.at[3:]])
        return toward(middle, pitch, back=SHORT + back, up=up)

    def _drawn_out(self, pitch: float) -> Array:
        return toward(self._standing(), pitch, back=SHORT + OUT, up=LIFTED)

    def _set_down(self, pitch: float) -> Array:
        """The cup stands on the table, before where it stood."""
        low = HEIGHT / 2 + ABOVE_TABLE - (self.cup.at[2] - TABLE_TOP)
        return toward(self._standing(), pitch, back=SHORT + BEFORE, up=low)

    def _standing(self) -> Array:
        """Where the cup stands at the start, x into the cabinet."""
        return np.concatenate([self.cup.at[:3], self.cabinet.at[3:]])

    def checks(self) -> Checks:
        return {
            "cup_outside": not self.cabinet.contains(self.cup.position),
            "cup_released": not self.robot.holds(self.cup),
        }

    def missing(self) -> Failure:
        if not self.searches[self.door.side].total:
            return Failure.UNFINISHED
        return Failure.NOT_PLACED

    def violations(self) -> list[Failure]:
        again = any(search.total > 1 for search in self.searches.values())
        fell = self.cup.position[2] < TABLE_TOP - FELL
        return [Failure.REPEATED_STEP] * again + [Failure.DROPPED_OBJECT] * fell

    def aliases(self) -> list[Alias]:
        last: Variation = {"cup_on": SIDES[-1]}
        return [Alias(Moment(0, last), Moment(6, last), "both sides shut, none or one searched")]

    def _searches_of(self, door: Door) -> Counter:
        return self.count(f"{door.side}_search", lambda: door.opening, up=SEEN, down=SHUT)
