"""Screw the bulb into the lamp until it lights, then put it into the holder it was not in.

HIDE appendix A.1 (i). Both holders look the same and are empty while the bulb is in the lamp or
in the hand: only the history tells where it came from. The light goes out when it is taken out.
"""

import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.light_bulb import Bulb, Holder, Lamp
from hide_tasks.assets.seat import Seat
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.general import move, over, put, take, top_down
from hide_tasks.poses import Array
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

HOLDERS = ("left", "right")  # as the robot sees them
LAMP_AREA = Area(x=(0.25, 0.29), y=(-0.06, 0.00))
HOLDER_AREA = Area(x=(0.06, 0.32), y=(0.17, 0.35))  # about RLBench's
SPACING = 0.08  # m between the holders' feet
APPROACH, LIFT = 0.10, 0.20  # m over a bulb
OVER_LAMP = 0.073  # m over the screwed-in bulb; RLBench light_bulb_in: 0.421 - 0.348
OUT = 0.12  # m over it, to where it is taken out; turned back on the way
STROKE = math.radians(165)  # of a turn; eleven of the 24 sides of what is turned on a lathe
STARTS = tuple(math.radians(degrees) for degrees in (120, 105, 135, 90))
FELL = 0.1  # m under the table's top


class LightBulbInOut(Task):
    category = Category.HISTORICAL_STATE_RECALL
    instructions = (
        "screw in the light bulb and move it to the other holder",
        "screw the light bulb into the lamp, then put it into the other holder",
        "light the bulb in the lamp and move it to the other stand",
        "try the bulb in the lamp, take it out and put it in the other holder",
    )
    variations = Grid(color=tuple(COLORS))
    histories = Grid(origin=HOLDERS)
    looks = ("color",)
    keyframes = frozenset({10, 11})
    remembers = "which holder the bulb came from"
    failures: ClassVar = {
        Failure.WRONG_RECALL: "the bulb went back to the holder that it came from",
        Failure.SKIPPED_STEP: "the bulb was put into the other holder unlit",
        Failure.REPEATED_STEP: "the bulb was lit twice",
        Failure.UNFINISHED: "the bulb never lit",
        Failure.NOT_PLACED: "the lit bulb is not in the other holder",
        Failure.DROPPED_OBJECT: "the bulb fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})

    def build(self) -> None:
        layout, color, origin = self.layout, self.variation.color, self.variation.origin
        self.bulb = Bulb()
        (self.lamp,) = layout.scatter([Lamp(self.bulb)], LAMP_AREA, gap=0.0)
        stands = layout.scatter([Holder(color), Holder(color)], HOLDER_AREA, gap=SPACING)
        stands.sort(key=lambda holder: -float(holder.at[1]))
        self.holders = dict(zip(HOLDERS, stands, strict=True))
        self.other = next(name for name in HOLDERS if name != origin)
        layout.add_at(self.bulb, self.holders[origin].seat)
        layout.seat(Seat(self.bulb, self.lamp.seat, firm=True))
        self.seats = {
            name: layout.seat(Seat(self.bulb, holder.seat, firm=True, taken=name == origin))
            for name, holder in self.holders.items()
        }
        self._count()

    def _count(self) -> None:
        self.lightings = self.count("lighting", lambda: float(self.bulb.lit), up=0.5, down=0.5)
        self.wrong = self._arrivals("wrong_return", self.variation.origin, lit=True)
        self.early = self._arrivals("placed_before_lit", self.other, lit=False)

    def _arrivals(self, name: str, holder: str, *, lit: bool) -> Counter:
        """How often the bulb came to stand in a holder after, or before, it was lit."""
        return self.count(
            name,
            lambda: float(self.seats[holder].taken),
            up=0.5,
            down=0.5,
            when=lambda: (self.lightings.total > 0) == lit,
        )

    def hidden_state(self) -> HiddenState:
        return {"origin": self.variation.origin, "lit": self.lightings.total > 0}

    def stage(self) -> str:
        if not self.lightings.total:
            return "screw in"
        if self.bulb.lit:
            return "take out"
        return "withdraw" if self.seats[self.other].taken else f"to {self.other}"

    def expert(self) -> Iterator[Stage]:
        start = self._start()
        end = start - STROKE
        goal = self.holders[self.other]
        yield Stage(
            "screw in",
            over(self._bulb, APPROACH, opened=True, yaw=start),
            take(self._bulb, yaw=start),
            over(self._bulb, LIFT, opened=False, yaw=start),
            move(lambda: self._lamp(start, OVER_LAMP), opened=False),
            move(lambda: self._lamp(start), opened=False, touching=True),
            move(lambda: self._lamp(end), touching=True),
        )
        yield Stage(
            "take out",
            take(self._bulb, yaw=end),
            move(lambda: self._lamp(start, OUT), opened=False, touching=True),
        )
        yield Stage(
            f"to {self.other}",
            over(lambda: goal.seat[:3], APPROACH, opened=False, yaw=start),
            put(lambda: goal.seat[:3], yaw=start),
        )
        yield Stage("withdraw", over(lambda: goal.seat[:3], LIFT, opened=True, yaw=start))

    def _start(self) -> float:
        """The tool's turn before the stroke, rad, that leaves the wrist room for all of it."""
        left, right = (self.holders[name].seat[:3] for name in HOLDERS)

        def chain(yaw: float) -> list[Array]:
            stroke = [self._lamp(yaw), self._lamp(yaw - STROKE), self._lamp(yaw, OUT)]
            above = self._lamp(yaw, OVER_LAMP)
            return [top_down(left, yaw), above, *stroke, top_down(right, yaw)]

        return STARTS[self.robot.first_feasible(chain(yaw) for yaw in STARTS)]

    def _lamp(self, yaw: float, above: float = 0.0) -> Array:
        """The tip's pose at a bulb in the lamp, or above it."""
        return top_down(self.lamp.seat[:3] + np.array([0, 0, above]), yaw)

    def checks(self) -> Checks:
        return {
            "bulb_lit": self.lightings.total > 0,
            "bulb_in_other_holder": self.seats[self.other].taken,
            "bulb_released": not self.robot.holds(self.bulb),
        }

    def missing(self) -> Failure:
        return Failure.NOT_PLACED if self.lightings.total else Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        fell = self.bulb.position[2] < TABLE_TOP - FELL
        return (
            [Failure.WRONG_RECALL] * (self.wrong.total > 0)
            + [Failure.SKIPPED_STEP] * (self.early.total > 0)
            + [Failure.REPEATED_STEP] * (self.lightings.total > 1)
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        one, two = HOLDERS
        return [
            Alias(
                Moment(8, {"origin": one}),
                Moment(8, {"origin": two}),
                f"taken out of the lamp; the bulb came from the {one} or the {two} holder",
            )
        ]

    def _bulb(self) -> Array:
        return np.array(self.bulb.position)
