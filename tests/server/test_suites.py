"""Named parts of the suite: what each plays, and what an evaluation covers."""

from collections.abc import Iterator
from typing import get_args

import pytest

from hide_tasks import SUITES, load
from hide_tasks.contract import Category
from server import suites
from server.db import Database
from server.problems import Problem
from server.schemas.common import SuiteName
from server.schemas.evaluations import EvaluationCreate
from tests.server import ledgers


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path_factory.mktemp("suites"))
    yield opened
    opened.close()


@pytest.mark.parametrize("name", SUITES)
def test_a_first_try_plays_one_task_of_each_category(name: str) -> None:
    tasks = suites.smoke_tasks(name)

    assert {load(task).category for task in tasks} == {load(one).category for one in SUITES[name]}
    assert len(tasks) <= len(Category)
    for task in SUITES[name]:
        rival = next(one for one in tasks if load(one).category is load(task).category)
        assert load(rival).budget() <= load(task).budget()


@pytest.mark.parametrize("name", get_args(SuiteName))
@pytest.mark.parametrize("split", ["val", "test"])
def test_an_evaluation_covers_the_suite_that_was_asked_for(
    database: Database, name: str, split: str
) -> None:
    with database.writing() as session:
        made = ledgers.created(session, "noop", suite=name, split=split)

        covered = "full" if name == "hide" else name
        assert (suites.covers(made), made.split) == (covered, split)


@pytest.mark.parametrize(
    "wanted",
    [{"episodes": 24}, {"tasks": [*SUITES["hide"]][1:]}, {"category": "RC", "episodes": 1},
     {"tasks": ["search_drawer"], "episodes": 1}],
)  # fmt: skip
def test_what_is_less_covers_a_part(database: Database, wanted: dict) -> None:
    with database.writing() as session:
        assert suites.covers(ledgers.created(session, "noop", **wanted)) == "part"


def test_an_evaluation_is_of_one_suite(database: Database) -> None:
    mixed = ["search_drawer", "real_stack_cups"]
    with database.writing() as session, pytest.raises(Problem, match="of suites hide and real4"):
        ledgers.created(session, "noop", tasks=mixed)


@pytest.mark.parametrize("name", ["hide-hard", "real4"])
def test_the_whole_of_another_suite_stands_on_its_board_alone(
    database: Database, name: str
) -> None:
    with database.writing() as session:
        made = ledgers.created(session, "noop", suite=name)

        assert made.suite == name
        assert suites.is_whole(made)
        assert suites.is_suite(made.tasks)


def test_a_first_try_does_not_look_at_held_out_episodes() -> None:
    assert suites.resolved(EvaluationCreate(policy="noop", suite="smoke")).split == "val"
    assert suites.resolved(EvaluationCreate(policy="noop", suite="full")).split == "test"


@pytest.mark.parametrize(
    "wanted", [{"tasks": ["search_drawer"]}, {"category": "RC"}, {"episodes": 1}]
)
def test_a_suite_chooses_by_itself(wanted: dict) -> None:
    with pytest.raises(Problem, match="is chosen by suite 'RC'"):
        suites.resolved(EvaluationCreate(policy="noop", suite="RC", **wanted))
