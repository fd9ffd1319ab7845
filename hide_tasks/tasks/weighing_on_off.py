"""Weigh the pepper, then put it into the container where it has not been.

HIDE appendix A.1 (f). Both containers are alike, and the pepper comes to stand on the scale in
one pose: once it is weighed, nothing shows from which container it came.
"""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.kitchen_scale import KitchenScale
from hide_tasks.assets.pepper import GRASP, HEIGHT, QUARTER, Pepper
from hide_tasks.assets.seat import Seat
from hide_tasks.assets.tray import Tray
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import move, top_down
from hide_tasks.poses import Array, point, yaw_of
from hide_tasks.task import Alias, Checks, Grid, Moment, Move, Stage, Task

SIDES = ("left", "right")  # of the containers, as the robot sees them
TRAYS_AT = {"left": (0.25, 0.31), "right": (0.25, 0.09)}  # m
SCALE_AT = (0.24, -0.20)  # m
JITTER = 0.018  # m, either way
TURN = 0.25  # rad, either way
DWELL = 180  # physics steps, of 240 a second, through which the scale must show the weight
HOVER, LIFT, RISE = 0.10, 0.20, 0.25  # m above the grasp point
FELL = 0.1  # m under the table's top


class WeighingOnOff(Task):
    category = Category.HISTORICAL_STATE_RECALL
    instructions = (
        "weigh the pepper and put it in another container",
        "put the pepper on the scale, then move it to the other container",
        "weigh the pepper, then place it in the container it did not come from",
    )
    variations = Grid(origin=SIDES)
    keyframes = frozenset({11})
    remembers = "from which container the pepper came"
    failures: ClassVar = {
        Failure.WRONG_RECALL: "the pepper went back to the container that it came from",
        Failure.SKIPPED_STEP: "the pepper was put into the other container unweighed",
        Failure.REPEATED_STEP: "the pepper was weighed twice",
        Failure.UNFINISHED: "the pepper was not weighed",
        Failure.NOT_PLACED: "the weighed pepper is in no container",
        Failure.DROPPED_OBJECT: "the pepper fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})

    def build(self) -> None:
        between = self.layout.between
        self.scale = self.layout.add(
            KitchenScale(), *self._near(SCALE_AT), yaw=between(-TURN, TURN)
        )
        self.trays = {
            side: self.layout.add(Tray(), *self._near(at), yaw=between(-TURN, TURN))
            for side, at in TRAYS_AT.items()
        }
        self.goal = next(side for side in SIDES if side != self.variation.origin)
        self.origin, self.target = self.trays[self.variation.origin], self.trays[self.goal]
        self.pepper = self.layout.add_at(Pepper(), _standing_in(self.origin))
        for place in (self._weighed_at(), *map(_standing_in, self.trays.values())):
            self.layout.seat(Seat(self.pepper, place, reach=0.02, period=QUARTER))
        self._count()

    def _near(self, at: tuple[float, float]) -> tuple[float, float]:
        x, y = (value + self.layout.between(-JITTER, JITTER) for value in at)
        return x, y

    def _weighed_at(self) -> Array:
        top = self.scale.top
        return np.concatenate([point(top, 0, 0, HEIGHT / 2), top[3:]])

    def _count(self) -> None:
        self.weighings = self.count("weighing", self._read, up=DWELL, down=1)
        self.returns = self.count(
            "return",
            lambda: float(self._lies_in(self.origin)),
            up=0.5,
            down=0.5,
            when=lambda: self.weighings.total > 0,
        )
        self.early = self.count(
            "unweighed",
            lambda: float(self._lies_in(self.target)),
            up=0.5,
            down=0.5,
            when=lambda: self.weighings.total == 0,
        )

    def _read(self) -> float:
        """For how many steps the scale has shown it; once read, it is until it leaves the pan."""
        if not self.scale.carries(self.pepper.position):
            return 0.0
        read = min(self.scale.steady, self.pepper.loose)
        return float(max(read, DWELL if self.weighings.high else 0))

    def _lies_in(self, tray: Tray) -> bool:
        return not self.robot.holds(self.pepper) and tray.contains(self.pepper.position)

    def hidden_state(self) -> HiddenState:
        return {"origin": self.variation.origin, "weighed": self.weighings.total > 0}

    def stage(self) -> str:
        if not self.weighings.total:
            return "weigh"
        if self._lies_in(self.target):
            return "withdraw"
        lifted = not self.scale.carries(self.pepper.position)
        return f"to {self.goal}" if lifted and self.robot.holds(self.pepper) else "take"

    def expert(self) -> Iterator[Stage]:
        start, weighed, goal = (
            _standing_in(self.origin),
            self._weighed_at(),
            _standing_in(self.target),
        )
        yield Stage(
            "weigh",
            _at(start, HOVER, opened=True),
            _at(start, 0.0, opened=False),
            _at(start, LIFT, opened=False),
            _at(weighed, HOVER, opened=False),
            _at(weighed, 0.0, opened=True),
            _at(weighed, RISE, opened=True),
        )
        yield Stage("take", _at(weighed, 0.0, opened=False), _at(weighed, LIFT, opened=False))
        yield Stage(f"to {self.goal}", _at(goal, HOVER, opened=False), _at(goal, 0.0, opened=True))
        yield Stage("withdraw", _at(goal, RISE, opened=True))

    def checks(self) -> Checks:
        return {
            "weighed": self.weighings.total > 0,
            "pepper_in_other_container": self._lies_in(self.target),
        }

    def missing(self) -> Failure:
        return Failure.NOT_PLACED if self.weighings.total else Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        fell = self.pepper.position[2] < TABLE_TOP - FELL
        return (
            [Failure.WRONG_RECALL] * (self.returns.total > 0)
            + [Failure.SKIPPED_STEP] * (self.early.total > 0)
            + [Failure.REPEATED_STEP] * (self.weighings.total > 1)
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        left, right = (Moment(8, {"origin": side}) for side in SIDES)
        return [Alias(left, right, "weighed; it came from the left or from the right")]


def _standing_in(tray: Tray) -> Array:
    return np.concatenate([tray.rest(HEIGHT), tray.at[3:]])


def _at(place: Array, height: float, *, opened: bool) -> Move:
    """Over or at the pepper that stands in a place."""
    where = top_down(place[:3] + np.array([0, 0, GRASP + height]), yaw_of(place))
    return move(lambda: where, opened=opened, touching=height == 0.0)
