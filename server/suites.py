"""What can be evaluated by a name: `smoke`, a category, a suite; `full` is `hide`, the paper's.

`smoke` asks whether a policy plays at all: one episode of one task of each category, of the
validation split unless another is named, for a first try should not look at held-out episodes.
"""

from collections.abc import Iterable
from functools import cache
from typing import Annotated, NamedTuple

from pydantic import AfterValidator

from hide_tasks import SUITES, load, suite
from hide_tasks.contract import Category, Split
from server.models import Evaluation
from server.problems import invalid
from server.schemas.common import Covers
from server.schemas.evaluations import EvaluationCreate
from workers.results import in_order

SMOKE_SPLIT: Split = "val"
BOARDS = {name: tasks for name, tasks in SUITES.items() if tasks}  # leaderboards, their tasks
CHOOSES = ("tasks", "category", "episodes")  # what a name chooses by itself


def _with_board(suite: str) -> str:
    if suite not in BOARDS:
        raise ValueError(f"is '{suite}'; the suites are {', '.join(BOARDS)}")
    return suite


BoardName = Annotated[str, AfterValidator(_with_board)]


class Place(NamedTuple):
    """Where policies stand beside each other: a suite, and a split of it."""

    suite: str
    split: str

    def __str__(self) -> str:
        return f"{self.suite}, {self.split}"


def resolved(wanted: EvaluationCreate) -> EvaluationCreate:
    """What is asked for, with its suite's tasks and episodes written out.

    Raises:
        Problem: 422, it names a suite and tasks, a category or a number of episodes as well.
    """
    if wanted.suite is None:
        return wanted
    for name in CHOOSES:
        if getattr(wanted, name) is not None:
            raise invalid(name, f"is chosen by suite '{wanted.suite}'; give one of them")
    if wanted.suite == "smoke":
        split = wanted.split if "split" in wanted.model_fields_set else SMOKE_SPLIT
        return wanted.model_copy(
            update={"tasks": list(smoke_tasks()), "episodes": 1, "split": split}
        )
    if wanted.suite in SUITES:
        return wanted.model_copy(update={"tasks": list(SUITES[wanted.suite])})
    category = None if wanted.suite == "full" else Category(wanted.suite)
    return wanted.model_copy(update={"category": category})


@cache
def _by_category(name: str = suite.SUITE) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {str(category): [] for category in Category}
    for task in SUITES[name]:
        found[str(load(task).category)].append(task)
    return found


@cache
def smoke_tasks(name: str = suite.SUITE) -> tuple[str, ...]:
    """Of each category of a suite the task that takes the fewest decisions."""
    groups = [tasks for tasks in _by_category(name).values() if tasks]
    return tuple(in_order([min(tasks, key=lambda task: load(task).budget()) for tasks in groups]))


def covers(evaluation: Evaluation) -> Covers:
    """The suite that an evaluation plays the whole of; "part" if it is none."""
    return covering(evaluation.split, evaluation.tasks, evaluation.episodes)


def covering(split: str, tasks: Iterable[str], episodes: int) -> Covers:
    """The same, of so many episodes of each of some tasks."""
    played = set(tasks)
    if episodes == suite.SPLITS.get(split):  # type: ignore[call-overload]
        named: Iterable[tuple[Covers, Iterable[str]]] = [
            ("full", SUITES[suite.SUITE]),
            ("RC", _by_category()["RC"]),
            ("HSR", _by_category()["HSR"]),
            ("EPT", _by_category()["EPT"]),
            ("hide-hard", SUITES["hide-hard"]),
            ("real4", SUITES["real4"]),
        ]
        return next((name for name, tasks in named if played == set(tasks)), "part")
    whole = episodes == 1 and played == set(smoke_tasks())
    return "smoke" if whole else "part"


WHOLE: tuple[Covers, ...] = ("full", "hide-hard", "real4")  # what a leaderboard ranks


def is_whole(evaluation: Evaluation) -> bool:
    """True if it is of every episode of its split, in the version of the suite that is here."""
    whole = "full" if evaluation.suite == suite.SUITE else evaluation.suite
    return evaluation.suite_version == suite.VERSION and covers(evaluation) == whole


def without_version(told: str) -> str:
    """The name of a suite that is told with its version, as `hide 1`."""
    return told.rpartition(" ")[0]


def is_suite(tasks: Iterable[str]) -> bool:
    """True if these are all the tasks of one suite."""
    return set(tasks) in map(set, SUITES.values())
