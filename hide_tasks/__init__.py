"""HIDE: robot tasks whose next action depends on what was seen and done before.

`SUITES` and `ALL_TASKS` name them, `load(name)` gives a task's class. Neither imports the
simulator.
"""

from hide_tasks.catalogue import ALL_TASKS, SUITES, UnknownTask, load

__all__ = ["ALL_TASKS", "SUITES", "UnknownTask", "load"]
