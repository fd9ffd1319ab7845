"""HIDE: robot tasks whose next action depends on what was seen and done before.

`ALL_TASKS` names them, `load(name)` gives a task's class. Neither imports the simulator.
"""

from hide_tasks.catalogue import ALL_TASKS, UnknownTask, load

__all__ = ["ALL_TASKS", "UnknownTask", "load"]
