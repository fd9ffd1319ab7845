"""Open the shoe boxes one by one until the shoes are found, then put both on the mat.

HIDE appendix A.1 (l). A searched box is shut and the arm goes home: the scene looks like the one
at the start, so only the history tells which box comes next.
"""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.region import Region
from hide_tasks.assets.shoe_boxes import SIDES, STANDS, Lid, Shoe, ShoeBoxes
from hide_tasks.contract import Category, Failure, HiddenState, Variation
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import home, over, put, take
from hide_tasks.motion.lids import (
    back_off,
    before_tab,
    behind_lid,
    lift,
    look_into,
    push_over,
    reach_for,
    slip_under,
)
from hide_tasks.poses import Array, compose, point, pose, yaw_of
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

BOXES_AT = (0.355, 0.0)  # m
TURN = 0.08  # rad, at most, either way
REGION_AT = (0.15, 0.0)  # m
REGION = 0.20  # m, square
PAIR = 0.068  # m of either shoe from the middle of its box
APART = 0.05  # m of either shoe from the middle of the mat
BACK = 0.02  # m of a shoe's shaft behind the middle of its box
GRIP = 0.022  # m of the tip over a shoe's frame
ABOVE_MAT = 0.004  # m, where a shoe is let go
SEEN = 0.3  # rad: a lid so far open shows something of what is in its box
WIDE = 1.0  # rad: so far open it lets the hand in
SHUT = 0.05  # rad
FELL = 0.1  # m under the table's top


class SearchBoxes(Task):
    category = Category.EXECUTION_PROGRESS
    instructions = (
        "take shoes out of box",
        "take the shoes out of the box",
        "grasp each shoe and remove it from the shoe box",
        "find the shoes in one of the boxes and put them on the table",
    )
    variations = Grid(shoes_in=SIDES)
    keyframes = frozenset({15, 16, 23, 24})
    remembers = "which boxes have been searched"
    failures: ClassVar = {
        Failure.REPEATED_STEP: "a box was searched again",
        Failure.UNFINISHED: "the shoes were not found",
        Failure.NOT_PLACED: "not both shoes are in the region",
        Failure.DROPPED_OBJECT: "a shoe fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})
    order: tuple[str, ...] = SIDES  # in which the expert searches

    def build(self) -> None:
        between = self.layout.between
        (x, y), jitter = BOXES_AT, (-0.015, 0.015)
        self.boxes = self.layout.add(
            ShoeBoxes(), x + between(*jitter), y + between(*jitter), yaw=between(-TURN, TURN)
        )
        self.region = self.layout.add(
            Region(REGION), *(at + between(*jitter) for at in REGION_AT), yaw=between(-TURN, TURN)
        )
        self.lid = self.boxes[self.variation.shoes_in]
        self.shoes = [self._shoe(self.lid, aside) for aside in (PAIR, -PAIR)]
        self.searches = {side: self._searches_of(self.boxes[side]) for side in SIDES}

    def _shoe(self, lid: Lid, aside: float) -> Shoe:
        between = self.layout.between
        floor = lid.floor(BACK + between(-0.004, 0.004), aside + between(-0.006, 0.006))
        return self.layout.add_at(Shoe(), compose(floor, pose(0, 0, STANDS + 0.0005)))

    def hidden_state(self) -> HiddenState:
        return {
            "shoes_in": self.variation.shoes_in,
            "searched": [side for side in SIDES if self.searches[side].total],
            "shoes_out": sum(map(self._out, self.shoes)),
        }

    def stage(self) -> str:
        left = [shoe for shoe in self.shoes if not self._out(shoe)]
        if self.lid.opening > WIDE or len(left) < len(self.shoes):
            return f"take {'second' if len(left) < len(self.shoes) else 'first'} shoe"
        others = (side for side in SIDES if side != self.lid.side)
        opened = next((side for side in others if self.boxes[side].opening > SHUT), None)
        if opened:
            return f"close {opened}"
        sides = [side for side in self.order if not self.searches[side].total]
        return f"open {sides[0] if sides else self.lid.side}"

    def expert(self) -> Iterator[Stage]:
        return self._search(self.order)

    def detours(self) -> list[Iterator[Stage]]:
        # Shows what to do with either box when it is open and empty.
        return [self._search(SIDES[::-1])] if self.variation.shoes_in == SIDES[0] else []

    def _search(self, order: tuple[str, ...]) -> Iterator[Stage]:
        for side in order:
            lid = self.boxes[side]
            reach = reach_for(self.robot, lid)
            yield Stage(
                f"open {side}",
                before_tab(lid, reach),
                slip_under(lid, reach),
                lift(lid, reach),
                back_off(lid, reach),
                look_into(lid),
            )
            if side == self.variation.shoes_in:
                break
            yield Stage(f"close {side}", behind_lid(lid), push_over(lid), home())
        yield self._take("first", self.shoes[0], APART)
        yield self._take("second", self.shoes[1], -APART)

    def _take(self, which: str, shoe: Shoe, aside: float) -> Stage:
        yaw = yaw_of(self.boxes.at)
        goal = point(self.region.at, 0.0, aside, STANDS + GRIP + ABOVE_MAT)

        def grip() -> Array:
            x, y, z = shoe.position
            return np.array([x, y, z + GRIP])

        return Stage(
            f"take {which} shoe",
            over(grip, 0.10, opened=True, yaw=yaw),
            take(grip, yaw=yaw),
            over(grip, 0.20, opened=False, yaw=yaw),
            over(lambda: goal, 0.08, opened=False, yaw=yaw),
            put(lambda: goal, yaw=yaw),
        )

    def checks(self) -> Checks:
        return {
            "both_shoes_in_region": all(map(self._out, self.shoes)),
            "shoes_released": not any(map(self.robot.holds, self.shoes)),
        }

    def missing(self) -> Failure:
        if not self.searches[self.lid.side].total:
            return Failure.UNFINISHED
        return Failure.NOT_PLACED

    def violations(self) -> list[Failure]:
        again = any(search.total > 1 for search in self.searches.values())
        fell = any(shoe.position[2] < TABLE_TOP - FELL for shoe in self.shoes)
        return [Failure.REPEATED_STEP] * again + [Failure.DROPPED_OBJECT] * fell

    def aliases(self) -> list[Alias]:
        last: Variation = {"shoes_in": self.order[-1]}
        return [Alias(Moment(0, last), Moment(8, last), "both boxes shut, none or one searched")]

    def _out(self, shoe: Shoe) -> bool:
        return self.region.contains(shoe.position) and not self.robot.holds(shoe)

    def _searches_of(self, lid: Lid) -> Counter:
        return self.count(f"{lid.side}_search", lambda: lid.opening, up=SEEN, down=SHUT)
