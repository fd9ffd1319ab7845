"""Close the open drawer, push the button, then open the same drawer again.

HIDE appendix A.1 (j). A detent shuts every drawer exactly and the button springs back, so once
the button is pressed nothing shows which drawer had been open.
"""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from hide_tasks.assets.button import COUNTS_AGAIN_AT, COUNTS_AT, Button
from hide_tasks.assets.chest import LEVELS, Chest, Drawer
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.buttons import above, press
from hide_tasks.motion.drawers import before, grasp_handle, pitch_for, slide_to
from hide_tasks.motion.general import move, top_down
from hide_tasks.poses import Array
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

SCALE = 0.7  # of RLBench's cabinet, as in MemoryBench's reopen_drawer
CHEST_AT = (0.57, 0.14)  # m
BUTTON_AREA = Area(x=(0.10, 0.34), y=(-0.40, -0.22))
OPEN = 0.15  # m: a drawer is open (RLBench open_drawer)
AJAR = 0.05  # m: a drawer has been tried
SHUT = 0.005  # m: a drawer is closed
PULL = 0.20  # m
HUB = (0.22, 0.0, 0.50)  # m above the table, whence the arm goes on after closing


class ReopenDrawer(Task):
    category = Category.HISTORICAL_STATE_RECALL
    instructions = (
        "close the opened drawer, push the button, and open the previous drawer again",
        "close the drawer, then reopen the previously opened drawer while pushing the button "
        "in between",
    )
    variations = Grid(origin=LEVELS)
    keyframes = frozenset({10})
    remembers = "which drawer was open at the start"
    failures: ClassVar = {
        Failure.WRONG_RECALL: "a drawer was opened that was not open at the start",
        Failure.SKIPPED_STEP: "the button was pressed, or the drawer opened, before its turn",
        Failure.REPEATED_STEP: "the button was pressed or the drawer shut twice",
        Failure.UNFINISHED: "not everything was done",
    }

    def build(self) -> None:
        between = self.layout.between
        x, y = CHEST_AT
        self.chest = self.layout.add(
            Chest(SCALE, open_level=self.variation.origin),
            x + between(-0.02, 0.02),
            y + between(-0.04, 0.04),
        )
        (self.button,) = self.layout.scatter([Button("magenta")], BUTTON_AREA, gap=0.0)
        self.drawer = self.chest[self.variation.origin]
        self.others = [d for d in self.chest.drawers() if d.level != self.drawer.level]
        self._count()

    def _count(self) -> None:
        drawer, button = self.drawer, self.button
        self.closings = self.count("closing", lambda: -drawer.opening, up=-SHUT, down=-AJAR)
        self.presses = self.count(
            "press", lambda: button.travel, up=COUNTS_AT, down=COUNTS_AGAIN_AT
        )
        self.presses_in_turn = self.count(
            "press_after_closing",
            lambda: button.travel,
            up=COUNTS_AT,
            down=COUNTS_AGAIN_AT,
            when=lambda: self.closings.total > 0,
        )
        self.openings = self.count("opening", lambda: drawer.opening, up=OPEN, down=AJAR)
        self.reopenings = self.count(
            "reopening",
            lambda: drawer.opening,
            up=OPEN,
            down=AJAR,
            when=lambda: self.presses_in_turn.total > 0,
        )
        self.wrong = [self._tries_of(other) for other in self.others]

    def _tries_of(self, other: Drawer) -> Counter:
        return self.count(f"{other.level}_opening", lambda: other.opening, up=AJAR, down=SHUT)

    def hidden_state(self) -> HiddenState:
        return {
            "origin": self.variation.origin,
            "closed": self.closings.total > 0,
            "pressed": self.presses_in_turn.total > 0,
        }

    def stage(self) -> str:
        if not self.closings.total:
            return "close"
        if not self.presses_in_turn.total:
            return "press"
        return "withdraw" if self.reopenings.total else f"reopen {self.drawer.level}"

    def expert(self) -> Iterator[Stage]:
        drawer, button = self.drawer, self.button
        pitch = pitch_for(self.robot, self.chest, drawer.level, PULL)
        yield Stage(
            "close",
            before(drawer, pitch),
            grasp_handle(drawer, pitch),
            slide_to(drawer, 0.0, pitch),
            move(self._hub),
        )
        yield Stage("press", above(button), press(button))
        yield Stage(
            f"reopen {drawer.level}",
            before(drawer, pitch),
            grasp_handle(drawer, pitch),
            slide_to(drawer, PULL, pitch),
        )
        yield Stage("withdraw", before(drawer, pitch))

    def _hub(self) -> Array:
        return top_down(np.array(HUB) + np.array([0.0, 0.0, TABLE_TOP]))

    def checks(self) -> Checks:
        return {
            "drawer_closed": self.closings.total > 0,
            "button_pressed": self.presses_in_turn.total > 0,
            "same_drawer_reopened": self.reopenings.total > 0,
        }

    def missing(self) -> Failure:
        return Failure.UNFINISHED

    def violations(self) -> list[Failure]:
        wrong = any(counter.total for counter in self.wrong)
        early = self.presses.total > self.presses_in_turn.total
        early |= self.openings.total > self.reopenings.total
        again = self.presses.total > 1 or self.closings.total > 1
        return (
            [Failure.WRONG_RECALL] * wrong
            + [Failure.SKIPPED_STEP] * early
            + [Failure.REPEATED_STEP] * again
        )

    def aliases(self) -> list[Alias]:
        return [
            Alias(
                Moment(6, {"origin": one}),
                Moment(6, {"origin": two}),
                f"the button is pressed; {one} or {two} was open before",
            )
            for one, two in (LEVELS[:2], LEVELS[1:], LEVELS[::2])
        ]
