"""Press the named button exactly N times, then withdraw the arm upward.

HIDE appendix A.1 (a). The cap springs back after each press and the arm rises to the same pose,
so the scene looks the same before the first press and after the last: only the history tells
when to stop.
"""

from collections.abc import Iterator
from typing import ClassVar

from hide_tasks.assets.button import COUNTS_AGAIN_AT, COUNTS_AT, Button
from hide_tasks.assets.colors import CLEAR_COLORS
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import Area
from hide_tasks.motion.buttons import above, press, withdraw
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

BUTTONS = 3
AREA = Area(x=(0.04, 0.46), y=(-0.29, 0.29))  # RLBench's boundary, less half a plate
SPACING = 0.04  # m between two buttons' circles: room for the hand
WITHDRAWN = 0.25  # m of the tip above the table


class PushButtonTimes(Task):
    category = Category.REPETITION_COUNTING
    instructions: ClassVar[tuple[str, ...]] = (
        "push the {color} button {count} times",
        "press the {color} button {count} times",
        "push down the button with the {color} base {count} times",
    )
    variations = Grid(count=(1, 2, 3, 4, 5), color=CLEAR_COLORS)
    looks = ("color",)
    palette: ClassVar[tuple[str, ...]] = CLEAR_COLORS
    area: ClassVar = AREA
    keyframes = frozenset({4, 6, 8, 10, 12})
    remembers = "how many presses are done"
    failures: ClassVar = {
        Failure.OVERCOUNT: "one press more than asked for",
        Failure.UNDERCOUNT: "fewer presses than asked for",
        Failure.WRONG_OBJECT: "a button of another colour was pressed",
        Failure.NOT_WITHDRAWN: "the arm stayed at the button",
    }
    spoils = frozenset({Failure.OVERCOUNT})

    def build(self) -> None:
        order = [self.palette[i] for i in self.layout.rng.permutation(len(self.palette))]
        others = [color for color in order if color != self.variation.color]
        colors = [self.variation.color, *others[: BUTTONS - 1]]
        self.target, *self.distractors = self.layout.scatter(
            map(Button, colors), self.area, gap=SPACING, turn=0.6
        )
        self.presses = self._presses_of("press", self.target)
        self.wrong = [self._presses_of("wrong_press", button) for button in self.distractors]

    def hidden_state(self) -> HiddenState:
        return {"presses_done": self.presses.total}

    def stage(self) -> str:
        if self.presses.total >= self.variation.count:
            return "withdraw"
        return "press" if self.presses.total else "reach"

    def expert(self) -> Iterator[Stage]:
        yield Stage("reach", above(self.target))
        for _ in range(self.variation.count):
            yield Stage("press", press(self.target), above(self.target))
        yield Stage("withdraw", withdraw(self.target))

    def checks(self) -> Checks:
        return {
            "pressed_exactly": self.presses.total == self.variation.count,
            "arm_withdrawn": self.robot.tip_height > WITHDRAWN,
        }

    def missing(self) -> Failure:
        if self.presses.total < self.variation.count:
            return Failure.UNDERCOUNT
        return Failure.NOT_WITHDRAWN

    def violations(self) -> list[Failure]:
        overcount = self.presses.total > self.variation.count
        wrong = any(counter.total for counter in self.wrong)
        return [Failure.OVERCOUNT] * overcount + [Failure.WRONG_OBJECT] * wrong

    def aliases(self) -> list[Alias]:
        return [
            Alias(
                Moment(1 + 2 * done),
                Moment(1 + 2 * self.variation.count),
                f"over the button after {done} presses and after the last",
            )
            for done in range(self.variation.count)
        ]

    def _presses_of(self, name: str, button: Button) -> Counter:
        return self.count(name, lambda: button.travel, up=COUNTS_AT, down=COUNTS_AGAIN_AT)
