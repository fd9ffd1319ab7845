"""Open the drawers one by one until the item is found, then put it on the mat.

HIDE appendix A.1 (k). A searched drawer is pushed shut and the arm goes home: the scene looks
like the one at the start, so only the history tells which drawer comes next.
"""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.block import Block
from hide_tasks.assets.chest import LEVELS, Chest, Drawer
from hide_tasks.assets.region import Region
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.drawers import (
    before,
    grasp_handle,
    look_into,
    pitch_for,
    push_shut,
    slide_to,
)
from hide_tasks.motion.general import home, over, put, take
from hide_tasks.poses import Array, quaternion, yaw_of
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

CHEST_AT = (0.61, 0.14)  # m
REGION_AT = (0.26, -0.28)  # m; the cabinet's top, where RLBench has it, is out of the arm's reach
TURN = 0.2  # rad, at most, either way
PULL = 0.20  # m
SEEN = 0.04  # m: a drawer so far open shows something of what is in it
WIDE = 0.10  # m: so far open it lets the hand in
SHUT = 0.01  # m
ABOVE_MAT = 0.004  # m, where the item is let go
FELL = 0.1  # m under the table's top


class SearchDrawer(Task):
    category = Category.EXECUTION_PROGRESS
    instructions = ("take item out of the drawer", "take the item out of the drawer")
    variations = Grid(item_in=LEVELS)
    keyframes = frozenset({9, 16, 23})
    remembers = "which drawers have been searched"
    failures: ClassVar = {
        Failure.REPEATED_STEP: "a drawer was searched again",
        Failure.UNFINISHED: "the item was not found",
        Failure.NOT_PLACED: "the item is not in the region",
        Failure.DROPPED_OBJECT: "the item fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})

    def build(self) -> None:
        between = self.layout.between
        x, y = CHEST_AT
        self.chest = self.layout.add(
            Chest(), x + between(-0.02, 0.02), y + between(-0.05, 0.05), yaw=between(-TURN, TURN)
        )
        self.region = self.layout.add(Region(), *(at + between(-0.04, 0.04) for at in REGION_AT))
        self.drawer = self.chest[self.variation.item_in]
        aside, turn = between(-0.06, 0.06), between(-0.4, 0.4)
        place = self.drawer.item_at_start(behind_front=0.06, aside=aside, above=0.0205)
        self.item = self.layout.add_at(
            Block("red"), np.concatenate([place[:3], quaternion(yaw=turn)])
        )
        self.searches = {drawer.level: self._searches_of(drawer) for drawer in self.chest.drawers()}

    def hidden_state(self) -> HiddenState:
        return {
            "item_in": self.variation.item_in,
            "searched": [level for level in LEVELS if self.searches[level].total],
        }

    def stage(self) -> str:
        if self.robot.holds(self.item) or self.region.contains(self.item.position):
            return "place"
        if self.drawer.opening > WIDE:
            return "take"
        others = (d for d in self.chest.drawers() if d.level != self.drawer.level)
        opened = next((drawer for drawer in others if drawer.opening > SHUT), None)
        if opened:
            return f"close {opened.level}"
        left = [level for level in LEVELS if not self.searches[level].total]
        return f"open {left[0] if left else self.drawer.level}"

    def expert(self) -> Iterator[Stage]:
        return self._search(LEVELS)

    def detours(self) -> list[Iterator[Stage]]:
        # Shows what to do with every drawer when it is open and empty.
        return [self._search(LEVELS[::-1])] if self.variation.item_in == LEVELS[0] else []

    def _search(self, order: tuple[str, ...]) -> Iterator[Stage]:
        for level in order:
            drawer = self.chest[level]
            pitch = pitch_for(self.robot, self.chest, level, PULL)
            yield Stage(
                f"open {level}",
                before(drawer, pitch),
                grasp_handle(drawer, pitch),
                slide_to(drawer, PULL, pitch),
                look_into(drawer),
            )
            if level == self.variation.item_in:
                break
            yield Stage(
                f"close {level}",
                before(drawer, pitch, opened=False),
                push_shut(drawer, pitch),
                home(),
            )
        yaw = yaw_of(self.chest.at)
        yield Stage("take", over(self._item, 0.10, opened=True, yaw=yaw), take(self._item, yaw=yaw))
        yield Stage(
            "place",
            over(self._item, 0.20, opened=False, yaw=yaw),
            over(self._goal, 0.08, opened=False, yaw=yaw),
            put(self._goal, yaw=yaw),
        )

    def checks(self) -> Checks:
        return {
            "item_in_region": self.region.contains(self.item.position),
            "item_released": not self.robot.holds(self.item),
        }

    def missing(self) -> Failure:
        if not self.searches[self.variation.item_in].total:
            return Failure.UNFINISHED
        return Failure.NOT_PLACED

    def violations(self) -> list[Failure]:
        again = any(search.total > 1 for search in self.searches.values())
        fell = self.item.position[2] < TABLE_TOP - FELL
        return [Failure.REPEATED_STEP] * again + [Failure.DROPPED_OBJECT] * fell

    def aliases(self) -> list[Alias]:
        return [
            Alias(
                Moment(7 * one, {"item_in": "bottom"}),
                Moment(7 * two, {"item_in": "bottom"}),
                f"all shut after {one} and after {two} searches",
            )
            for one, two in ((0, 1), (1, 2), (0, 2))
        ]

    def _searches_of(self, drawer: Drawer) -> Counter:
        return self.count(f"{drawer.level}_search", lambda: drawer.opening, up=SEEN, down=SHUT)

    def _item(self) -> Array:
        return np.array(self.item.position)

    def _goal(self) -> Array:
        x, y, z = self.region.at[:3]
        return np.array([x, y, z + self.item.size / 2 + ABOVE_MAT])
