"""Every task says which failures can occur in it, and a test of its own provokes each."""

import ast
import inspect
from pathlib import Path

import pytest

from hide_tasks import ALL_TASKS, load
from hide_tasks.certificates import committed
from hide_tasks.contract import Failure
from hide_tasks.task import Task

TESTS = Path(__file__).parent
NOT_THE_TASKS = {Failure.UNREACHABLE_POSE} | {f for f in Failure if f.startswith("policy")}


def named(path: Path) -> set[Failure]:
    """The failures that a file speaks of, outside of what declares them."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            node.body = [part for part in node.body if not isinstance(part, ast.AnnAssign)]
    return {
        Failure[node.attr]
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "Failure"
    }


def files(name: str) -> list[Path]:
    """A task's file and those of the tasks that it extends."""
    classes = [one for one in load(name).__mro__ if issubclass(one, Task) and one is not Task]
    return [Path(inspect.getfile(one)) for one in classes]


def spoken_of(paths: list[Path]) -> set[Failure]:
    return {failure for path in paths for failure in named(path)}


@pytest.mark.parametrize("name", ALL_TASKS)
def test_a_task_declares_the_failures_that_it_names(name):
    own, *_ = extended = files(name)
    assert spoken_of([own]) <= set(load(name).failures) <= spoken_of(extended)
    assert not NOT_THE_TASKS & set(load(name).failures)
    assert load(name).spoils <= set(load(name).failures)


@pytest.mark.parametrize("name", ALL_TASKS)
def test_a_test_provokes_each(name):
    tests = [TESTS / path.parent.name / f"test_{path.name}" for path in files(name)]

    assert set(load(name).failures) <= spoken_of(tests)


@pytest.mark.parametrize("name", [name for name in ALL_TASKS if committed(name)])
def test_policies_that_played_it_failed_in_these_ways_alone(name):
    proof = committed(name)
    played = [proof["amnesiac"], *proof["adversaries"].values()]

    assert {f for one in played for f in one["failures"]} <= set(
        load(name).failures
    ) | NOT_THE_TASKS
