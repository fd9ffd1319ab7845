"""Lift the blocks one by one until the white chip is found, then take its block away.

HIDE appendix A.1 (n). A block that covers nothing is put back exactly where it stood and the arm
goes home: the scene looks like the one at the start, so only the history tells which block is
next.
"""

import math
from collections.abc import Iterator, Sequence
from typing import ClassVar

from hide_tasks.assets.block import Block
from hide_tasks.assets.chip import Chip
from hide_tasks.assets.colors import COLORS
from hide_tasks.assets.region import Region
from hide_tasks.assets.seat import Seat
from hide_tasks.contract import Category, Failure, HiddenState, Variation
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.blocks import above, carry_over, grasp, grip_yaw, let_go, lift, rise_from
from hide_tasks.motion.general import home
from hide_tasks.poses import Array, point
from hide_tasks.task import Alias, Checks, Counter, Grid, Moment, Stage, Task

PLACES = ("first", "second", "third", "fourth")  # from the robot's left
SIZE, MASS = 0.05, 0.125  # m, kg; RLBench stack_blocks
AREA = Area(x=(0.12, 0.42), y=(-0.20, 0.30))
GAP = 0.02  # m between two blocks' circles: 0.12 from middle to middle, room for the fingers
TURN = 0.6  # rad, at most, either way
REGION_AT = (0.25, -0.35)  # m
SIDE = 0.15  # m of the region
CHECKED = 0.008  # m that a block is off its place, either way: what is under it shows
BACK = 0.003  # m off its place: a block stands where it stood
REACH = 0.015  # m off its place, where a block that is let go slides into it, however turned
LOOK = 0.15  # m that a block is lifted: the wrist camera looks past it onto its place
ABOVE_MAT = 0.004  # m, where the block is let go
CLEAR = 0.12  # m above the region
FELL = 0.1  # m under the table's top


class LiftAndCheck(Task):
    category = Category.EXECUTION_PROGRESS
    instructions: ClassVar[tuple[str, ...]] = (
        "lift blocks one by one to find the white chip underneath and remove it",
        "lift the blocks one by one, find the white chip underneath and move its block away",
    )
    variations = Grid(chip_under=PLACES, color=tuple(COLORS))
    looks = ("color",)
    places: ClassVar[tuple[str, ...]] = PLACES
    tall: ClassVar = SIZE  # m of a block
    keyframes = frozenset({6, 11, 16, 21})
    remembers = "which blocks have been lifted"
    failures: ClassVar = {
        Failure.REPEATED_STEP: "a block was lifted again",
        Failure.SKIPPED_STEP: "the next block was taken before the last one was back",
        Failure.WRONG_OBJECT: "an empty block was put into the region",
        Failure.UNFINISHED: "the chip was not found",
        Failure.NOT_PLACED: "its block is not in the region",
        Failure.DROPPED_OBJECT: "its block fell off the table",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})

    def build(self) -> None:
        layout = self.layout
        x, y = (at + layout.between(-0.03, 0.03) for at in REGION_AT)
        self.region = layout.add(Region(side=SIDE), x, y)
        from_left = sorted(self._scattered(), key=lambda block: -float(block.at[1]))
        self.blocks = dict(zip(self.places, from_left, strict=True))
        for place, block in self.blocks.items():
            self._hide(block, there=place == self.variation.chip_under)
            block.at[2] += self.tall / 2
            layout.seat(Seat(block, block.at, REACH, firm=True, taken=True))
        self.target = self.blocks[self.variation.chip_under]
        self.searches = {place: self._searches_of(place) for place in self.places}

    def _scattered(self) -> list[Block]:
        blocks = [Block(self.variation.color, SIZE, MASS) for _ in self.places]
        return self.layout.scatter(blocks, AREA, gap=GAP, turn=TURN)

    def _hide(self, block: Block, *, there: bool) -> None:
        """A chip under a block, or its empty place."""
        self.layout.add(Chip(there), block.at[0], block.at[1])

    def hidden_state(self) -> HiddenState:
        return {
            "chip_under": self.variation.chip_under,
            "checked": [place for place in self.places if self.searches[place].total],
        }

    def stage(self) -> str:
        if self._removed():
            return "withdraw"
        off = [place for place in self.places if self._off(place) > CHECKED]
        if self.variation.chip_under in off:
            return "remove"
        if off:
            return f"put back {off[0]}"
        left = [place for place in self.places if not self.searches[place].total]
        return f"lift {left[0] if left else self.variation.chip_under}"

    def expert(self) -> Iterator[Stage]:
        return self._search(self.places)

    def detours(self) -> list[Iterator[Stage]]:
        # Shows what to do with every block when it is lifted and covers nothing.
        return (
            [self._search(self.places[::-1])] if self.variation.chip_under == self.places[0] else []
        )

    def _search(self, order: Sequence[str]) -> Iterator[Stage]:
        for place in order:
            block = self.blocks[place]
            yield Stage(f"lift {place}", above(block), grasp(block), lift(block, LOOK))
            if block is self.target:
                break
            yield Stage(f"put back {place}", let_go(block.at[:3], grip_yaw(block)), home())
        goal = self._goal()
        yield Stage("remove", carry_over(goal, CLEAR), let_go(goal))
        yield Stage("withdraw", rise_from(goal, 2 * CLEAR))

    def checks(self) -> Checks:
        return {
            "block_in_region": self.region.contains(self.target.position),
            "block_released": not self.robot.holds(self.target),
        }

    def missing(self) -> Failure:
        if not self.searches[self.variation.chip_under].total:
            return Failure.UNFINISHED
        return Failure.NOT_PLACED

    def violations(self) -> list[Failure]:
        again = any(search.total > 1 for search in self.searches.values())
        wrong = any(self._rests_in_region(b) for b in self.blocks.values() if b is not self.target)
        fell = self.target.position[2] < TABLE_TOP - FELL
        return (
            [Failure.REPEATED_STEP] * again
            + [Failure.SKIPPED_STEP] * self._left_behind()
            + [Failure.WRONG_OBJECT] * wrong
            + [Failure.DROPPED_OBJECT] * fell
        )

    def aliases(self) -> list[Alias]:
        last: Variation = {"chip_under": self.places[-1]}
        return [
            Alias(
                Moment(5 * one, last),
                Moment(5 * two, last),
                f"all blocks down after {one} and after {two} were lifted",
            )
            for one in range(len(self.places))
            for two in range(one + 1, len(self.places))
        ]

    def _searches_of(self, place: str) -> Counter:
        return self.count(f"{place}_lift", lambda: self._off(place), up=CHECKED, down=BACK)

    def _left_behind(self) -> bool:
        """True when a block is held while an empty one stands astray: that would mark the way."""
        others = [place for place in self.places if place != self.variation.chip_under]
        held = any(self.robot.holds(block) for block in self.blocks.values())
        return held and any(map(self._astray, others))

    def _astray(self, place: str) -> bool:
        return self._off(place) > CHECKED and not self.robot.holds(self.blocks[place])

    def _off(self, place: str) -> float:
        """How far a block is from where it stood, m."""
        block = self.blocks[place]
        return math.dist(block.position, block.at[:3])

    def _rests_in_region(self, block: Block) -> bool:
        return self.region.contains(block.position) and not self.robot.holds(block)

    def _removed(self) -> bool:
        return all(self.checks().values())

    def _goal(self) -> Array:
        return point(self.region.at, 0, 0, self.tall / 2 + ABOVE_MAT)
