"""The suites and their tasks by name. Readable with numpy alone.

A suite is a package of this one, a task a file in it; no two tasks have one name.
"""

import difflib
import importlib
import inspect
import pkgutil
from pathlib import Path

from hide_tasks.contract import CAMERAS
from hide_tasks.task import Task

_FOLDERS = {"hide": "tasks", "hide-hard": "hard", "real4": "real4"}


def _tasks_in(folder: str) -> tuple[str, ...]:
    path = Path(__file__).parent / folder
    return tuple(sorted(module.name for module in pkgutil.iter_modules([str(path)])))


SUITES: dict[str, tuple[str, ...]] = {name: _tasks_in(at) for name, at in _FOLDERS.items()}
ALL_TASKS: tuple[str, ...] = tuple(task for tasks in SUITES.values() for task in tasks)
_SUITE_OF = {task: suite for suite, tasks in SUITES.items() for task in tasks}


class UnknownTask(ValueError):
    """No task has this name; the message names the nearest and all."""


def load(name: str) -> type[Task]:
    """The class of a task.

    Raises:
        UnknownTask: no suite has it.
    """
    module = importlib.import_module(f"hide_tasks.{_FOLDERS[suite_of(name)]}.{name}")
    found = [
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Task)
        and value.__module__ == module.__name__
    ]
    return found[0]


def suite_of(task: str) -> str:
    """The name of the suite that a task belongs to.

    Raises:
        UnknownTask: no suite has it.
    """
    if task not in _SUITE_OF:
        near = difflib.get_close_matches(task, ALL_TASKS, n=1, cutoff=0.4)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise UnknownTask(f"No task '{task}'.{hint} All: {', '.join(ALL_TASKS)}.")
    return _SUITE_OF[task]


def cameras_of(suite: str) -> tuple[str, ...]:
    """What the tasks of a suite are seen through; all cameras if it is unknown or empty."""
    tasks = SUITES.get(suite, ())
    return load(tasks[0]).cameras if tasks else CAMERAS


def file_of(task: str) -> str:
    """A task's file, relative to the package."""
    return f"{_FOLDERS[suite_of(task)]}/{task}.py"
