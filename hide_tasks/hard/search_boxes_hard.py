"""Search the shoe boxes in the order that the instruction names, each once.

`search_boxes` lets a guess and its complement be exact: whoever opens the other box after an empty
one never repeats a step. With a stated order, two shut boxes call for one box at the start and for
the other after a miss.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from hide_tasks.assets.shoe_boxes import SIDES
from hide_tasks.contract import Failure, Value
from hide_tasks.task import Grid, Stage
from hide_tasks.tasks.search_boxes import SEEN, SHUT, SearchBoxes


class SearchBoxesHard(SearchBoxes):
    instructions = (
        "take shoes out of box, searching the {first} box first, then the {second} box",
        "look into the {first} box, then into the {second} box, and take the shoes out",
        "open the {first} box first, the {second} box if need be, and remove the shoes",
        "find the shoes and put them on the table; open the {first} box before the {second} box",
    )
    variations = Grid(shoes_in=SIDES, first=SIDES)
    failures: ClassVar = {
        **SearchBoxes.failures,
        Failure.SKIPPED_STEP: "the second box was opened before the first",
    }
    spoils = SearchBoxes.spoils | {Failure.SKIPPED_STEP, Failure.REPEATED_STEP}

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return {**variation, "second": _other(str(variation["first"]))}

    def build(self) -> None:
        super().build()
        first, second = self.order = (self.variation.first, _other(self.variation.first))
        self.early = self.count(
            "early_search",
            lambda: self.boxes[second].opening,
            up=SEEN,
            down=SHUT,
            when=lambda: not self.searches[first].total,
        )

    def detours(self) -> list[Iterator[Stage]]:
        return []  # the other order is wrong

    def violations(self) -> list[Failure]:
        return [*super().violations(), *[Failure.SKIPPED_STEP] * (self.early.total > 0)]


def _other(side: str) -> str:
    return next(one for one in SIDES if one != side)
