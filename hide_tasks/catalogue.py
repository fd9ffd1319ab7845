"""The tasks by name. Readable with numpy alone."""

import difflib
import importlib
import inspect
import pkgutil

from hide_tasks import tasks
from hide_tasks.task import Task

ALL_TASKS: tuple[str, ...] = tuple(
    sorted(module.name for module in pkgutil.iter_modules(tasks.__path__))
)


class UnknownTask(ValueError):
    """No task has this name; the message names the nearest and all."""


def load(name: str) -> type[Task]:
    """The class of a task.

    Raises:
        UnknownTask: there is no `hide_tasks/tasks/<name>.py`.
    """
    if name not in ALL_TASKS:
        near = difflib.get_close_matches(name, ALL_TASKS, n=1, cutoff=0.4)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise UnknownTask(f"No task '{name}'.{hint} All: {', '.join(ALL_TASKS)}.")
    module = importlib.import_module(f"hide_tasks.tasks.{name}")
    found = [
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Task)
        and value.__module__ == module.__name__
    ]
    return found[0]
