"""Search the cabinet's sides in the order that the instruction names, each once.

`search_cup_from_cabinet` lets a guess and its complement be exact: whoever opens the other side
after an empty one never repeats a step. With a stated order, two shut doors call for one side at
the start and for the other after a miss.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

from hide_tasks.assets.cabinet import SIDES
from hide_tasks.contract import Failure, Value
from hide_tasks.task import Grid, Stage
from hide_tasks.tasks.search_cup_from_cabinet import SEEN, SHUT, SearchCupFromCabinet


class SearchCupFromCabinetHard(SearchCupFromCabinet):
    instructions = (
        "take out a cup from the cabinet, searching the {first} side first, then the {second} side",
        "take a cup out of the cabinet; open the {first} side before the {second} side",
        "look behind the {first} door, then behind the {second} door, and take the cup out",
    )
    variations = Grid(cup_on=SIDES, first=SIDES)
    failures: ClassVar = {
        **SearchCupFromCabinet.failures,
        Failure.SKIPPED_STEP: "the second side was opened before the first",
    }
    spoils = SearchCupFromCabinet.spoils | {Failure.SKIPPED_STEP, Failure.REPEATED_STEP}

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        return {**variation, "second": _other(str(variation["first"]))}

    def build(self) -> None:
        super().build()
        first, second = self.order = (self.variation.first, _other(self.variation.first))
        self.early = self.count(
            "early_search",
            lambda: self.cabinet[second].opening,
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
