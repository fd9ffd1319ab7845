"""Lay the remote on the mat so that it points at the television, then press its button N times.

HIDE appendix A.1 (c). The television shows no channel's number, the remote does not stir, its
button springs back, and the arm rises to the same pose after every press: the scene looks the
same before the first press and after the last.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from hide_tasks.assets.remote import (
    AHEAD,
    CAP_RISE,
    COUNTS_AGAIN_AT,
    COUNTS_AT,
    HEIGHT,
    Mat,
    Remote,
    Sign,
)
from hide_tasks.assets.seat import Seat
from hide_tasks.assets.television import Television
from hide_tasks.contract import Category, Failure, HiddenState, Value
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.general import move, over, put, take, top_down
from hide_tasks.panda import FINGERTIP
from hide_tasks.poses import Array, point, yaw_of
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Move, Stage, Task

SIGN_OF: dict[str, Sign] = {"up": "plus", "minus": "minus"}
TIMES = {1: "once", 2: "twice", 3: "three times"}
TELEVISION_AT = (0.76, 0.0)  # m
MAT_AREA = Area(x=(0.19, 0.25), y=(-0.03, 0.03))
REMOTE_AREA = Area(x=(0.12, 0.22), y=(0.20, 0.28))  # to the left or to the right
REMOTE_TURN = 1.2  # rad either way
GRIP = 0.004  # m above the remote's middle that the fingers take it
HOVER = 0.089  # m above a button (RLBench change_channel)
PRESS = 0.0075  # m that a press goes down: well over the 5 mm that count, under the cap's 8 mm
RISE = 0.35  # m of the tip above the table, when the arm withdraws
WITHDRAWN = 0.25  # m of the tip above the table
FELL = 0.1  # m under the table's top


class ChangeChannelTimes(Task):
    category = Category.REPETITION_COUNTING
    instructions = (
        "turn the channel {direction} {times}",
        "press the channel {sign} button of the remote {times}",
        "point the remote at the television and press {sign} {times}",
        "pick up the remote and turn the channel {direction} {times}",
        "change the television's channel by pressing {sign} {times}",
    )
    variations = Grid(direction=("up", "minus"), count=(1, 2, 3))
    keyframes = frozenset({10, 12, 14})
    remembers = "how many presses are done"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one press more than asked for",
        Failure.UNDERCOUNT: "fewer presses than asked for",
        Failure.WRONG_OBJECT: "the other button was pressed",
        Failure.SKIPPED_STEP: "a press before the remote points at the television",
        Failure.NOT_PLACED: "the remote is not on its mat",
        Failure.DROPPED_OBJECT: "the remote fell off the table",
        Failure.NOT_WITHDRAWN: "the arm stayed at the button",
    }
    spoils = frozenset({Failure.OVERCOUNT, Failure.DROPPED_OBJECT})

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        """The direction's button and the count as one says them."""
        direction, count = variation["direction"], variation["count"]
        assert isinstance(direction, str) and isinstance(count, int)
        return {"direction": direction, "sign": SIGN_OF[direction], "times": TIMES[count]}

    def build(self) -> None:
        layout = self.layout
        layout.add(Television(), *TELEVISION_AT)
        (self.mat,) = layout.scatter([Mat()], MAT_AREA, gap=0.0)
        side = 1 if layout.between(-1, 1) > 0 else -1
        (self.remote,) = layout.scatter([Remote()], REMOTE_AREA, gap=0.0, turn=REMOTE_TURN)
        self.remote.at[1] *= side
        self.remote.at[2] += HEIGHT / 2
        self.seat = layout.seat(Seat(self.remote, self.mat.rest, turn=0.3, firm=True))
        self.sign = SIGN_OF[self.variation.direction]
        other: Sign = "minus" if self.sign == "plus" else "plus"
        self.presses = self._presses_of("press", self.sign, pointed=True)
        self.early = self._presses_of("press_too_early", self.sign, pointed=False)
        self.wrong = self._presses_of("wrong_press", other)

    def _presses_of(self, name: str, sign: Sign, pointed: bool | None = None) -> Counter:
        """Presses of a button; only with the remote on its mat, only elsewhere, or anywhere."""
        return self.count(
            name,
            lambda: self.remote.travel(sign),
            up=COUNTS_AT,
            down=COUNTS_AGAIN_AT,
            when=lambda: pointed is None or pointed == self.seat.taken,
        )

    def hidden_state(self) -> HiddenState:
        return {"presses_done": self.presses.total}

    def stage(self) -> str:
        if not self.seat.taken:
            return "point the remote"
        if self.presses.total >= self.variation.count:
            return "withdraw"
        return "press" if self.presses.total else "reach"

    def expert(self) -> Iterator[Stage]:
        start, end = yaw_of(self.remote.at), yaw_of(self.mat.at)
        yield Stage(
            "point the remote",
            over(self._remote, 0.10, opened=True, yaw=start),
            take(self._remote, yaw=start),
            over(self._remote, 0.20, opened=False, yaw=start),
            over(self._goal, 0.10, opened=False, yaw=end),
            put(self._goal, yaw=end),
            over(self._goal, 0.15, opened=True, yaw=end),
        )
        yield Stage("reach", self._over_button(HOVER))
        for _ in range(self.variation.count):
            yield Stage("press", self._press(), self._over_button(HOVER))
        yield Stage("withdraw", self._over_button(RISE + TABLE_TOP - self._button()[2]))

    def checks(self) -> Checks:
        return {
            "remote_points_at_television": self.seat.taken,
            "pressed_exactly": self.presses.total == self.variation.count,
            "arm_withdrawn": self.robot.tip_height > WITHDRAWN,
        }

    def missing(self) -> Failure:
        if not self.seat.taken:
            return Failure.NOT_PLACED
        if self.presses.total < self.variation.count:
            return Failure.UNDERCOUNT
        return Failure.NOT_WITHDRAWN

    def violations(self) -> list[Failure]:
        fell = self.remote.position[2] < TABLE_TOP - FELL
        return (
            [Failure.OVERCOUNT] * (self.presses.total > self.variation.count)
            + [Failure.WRONG_OBJECT] * (self.wrong.total > 0)
            + [Failure.SKIPPED_STEP] * (self.early.total > 0)
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        return [
            Alias(
                Moment(7 + 2 * done),
                Moment(7 + 2 * self.variation.count),
                f"over the button after {done} presses and after the last",
            )
            for done in range(self.variation.count)
        ]

    def _remote(self) -> Array:
        x, y, z = self.remote.position
        return np.array([x, y, z + GRIP])

    def _goal(self) -> Array:
        return point(self.mat.rest, 0, 0, GRIP)

    def _button(self) -> Array:
        """The middle of the resting cap's upper face, with the remote on its mat."""
        return point(self.mat.rest, AHEAD[self.sign], 0, HEIGHT / 2 + CAP_RISE)

    def _over_button(self, height: float) -> Move:
        return over(self._button, height, opened=False, yaw=yaw_of(self.mat.at))

    def _press(self) -> Move:
        def where() -> Array:
            return top_down(self._button() + np.array([0, 0, FINGERTIP - PRESS]))

        return move(where, opened=False, touching=True)
