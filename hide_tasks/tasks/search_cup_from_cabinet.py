"""Open the sides of the cabinet one by one until the cup is found, then take it out.

HIDE appendix A.1 (m). A searched side is slid shut and the arm goes home: the scene looks like
the one at the start, so only the history tells which side comes next.
"""

import itertools
import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.cabinet import SIDES, Cabinet, Door
from hide_tasks.assets.mug import HEIGHT, RADIUS, Mug
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
SEEN = 0.04  # m: a door so far open shows something of what is behind it
WIDE = 0.12  # m: so far open it lets the hand in
SHUT = 0.01  # m
BEHIND = 0.035  # m of the cup behind the front: the palm stays outside
ASIDE = 0.025  # m of the cup outward from the middle of a side: room for the palm
SHORT = 0.008  # m of the tip before the cup's middle
ABOUT = 0.10  # m before the cup, whence it is grasped
OUT, LIFTED = 0.16, 0.02  # m that the cup is drawn out, and up
# How the tool may be held at the cup, rad: pitch, and yaw to the left.
TILTS = tuple(
    (math.radians(pitch), math.radians(yaw))
    for pitch, yaw in itertools.product((15, 20, 10, 25, 30), (0, 8, -8, 14, -14))
)
BEFORE, ABOVE_TABLE = 0.24, 0.004  # m before where it stood and over the table: there it is let go
FELL = 0.1  # m under the table's top

Tilt = tuple[float, float]


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
    failures: ClassVar = {
        Failure.REPEATED_STEP: "a side was searched again",
        Failure.UNFINISHED: "the cup was not found",
        Failure.NOT_PLACED: "the cup is still in the cabinet or in the hand",
        Failure.DROPPED_OBJECT: "the cup fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})
    order: tuple[str, ...] = SIDES  # in which the expert searches

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
        if self.robot.holds(self.cup) or not self._within():
            return "take out"
        if self.door.opening > WIDE:
            return "take"
        others = (side for side in SIDES if side != self.door.side)
        opened = next((side for side in others if self.cabinet[side].opening > SHUT), None)
        if opened:
            return f"close {opened}"
        left = [side for side in self.order if not self.searches[side].total]
        return f"open {left[0] if left else self.door.side}"

    def expert(self) -> Iterator[Stage]:
        return self._search(self.order)

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
        tilt = self._tilt()
        yield Stage(
            "take",
            move(lambda: self._grip(tilt, back=ABOUT)),
            move(lambda: self._grip(tilt), opened=False, touching=True),
        )
        yield Stage(
            "take out",
            move(lambda: self._drawn_out(tilt), opened=False),
            move(lambda: self._set_down(tilt), touching=True),
        )

    def _tilt(self) -> Tilt:
        """How the arm can hold the tool to follow the cup all the way."""
        chains = (
            [self._grip(t, back=ABOUT), self._grip(t), self._drawn_out(t), self._set_down(t)]
            for t in TILTS
        )
        return TILTS[self.robot.first_feasible(chains)]

    def _grip(self, tilt: Tilt, *, back: float = 0.0, up: float = 0.0) -> Array:
        """Where the cup stands at the start, or so far before and over it."""
        pitch, yaw = tilt
        standing = np.concatenate([self.cup.at[:3], self.cabinet.at[3:]])
        at = compose(standing, pose(-back, 0, up))
        return toward(compose(at, pose(0, 0, 0, quaternion(yaw=yaw))), pitch, back=SHORT)

    def _drawn_out(self, tilt: Tilt) -> Array:
        return self._grip(tilt, back=OUT, up=LIFTED)

    def _set_down(self, tilt: Tilt) -> Array:
        """The cup stands on the table, before where it stood."""
        low = HEIGHT / 2 + ABOVE_TABLE - (self.cup.at[2] - TABLE_TOP)
        return self._grip(tilt, back=BEFORE, up=low)

    def checks(self) -> Checks:
        return {
            "cup_outside": not self._within(),
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
        last: Variation = {"cup_on": self.order[-1]}
        return [Alias(Moment(0, last), Moment(6, last), "both sides shut, none or one searched")]

    def _within(self) -> bool:
        return self.cabinet.contains(self.cup.position, RADIUS)

    def _searches_of(self, door: Door) -> Counter:
        return self.count(f"{door.side}_search", lambda: door.opening, up=SEEN, down=SHUT)
