"""Why a policy cannot play some tasks at all: asked before anything is played."""

from collections.abc import Iterable, Sequence

from hide_tasks import load
from hide_tasks.catalogue import suite_of


def is_of_another_suite(name: str, trained_on: str, tasks: Iterable[str]) -> str:
    """Why weights that were trained on one suite do not play these tasks; empty if they do."""
    others = sorted({suite_of(task) for task in tasks} - {trained_on})
    if not others:
        return ""
    return (
        f"{name} was trained on suite {trained_on}; these tasks are of {' and '.join(others)}. "
        f"Evaluate it on {trained_on}, or train one on demonstrations of {others[0]}."
    )


def lacks_camera(name: str, seen: Sequence[str], tasks: Iterable[str]) -> str:
    """Why a policy that is told what these cameras see cannot play these tasks; empty if it can."""
    for task in tasks:
        there = load(task).cameras
        for camera in seen:
            if camera not in there:
                return (
                    f"{name} is to see the camera {camera}, and {task} has {', '.join(there)} "
                    f"alone. Leave {camera} out of its map, or evaluate it on tasks that have it."
                )
    return ""
