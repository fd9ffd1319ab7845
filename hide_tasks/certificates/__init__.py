"""The committed certificates: one file a task, readable without the simulator."""

import json
from functools import lru_cache
from importlib.resources import files
from typing import Any, Literal, NamedTuple


class Certificate(NamedTuple):
    """What a task's score means."""

    task: str
    verdict: Literal["strong", "weak"]
    reason: str
    ceiling_success: float  # the most that a perfect policy without memory reaches
    ceiling_exact: float
    amnesiac_success: float  # what such a policy did reach on the test split
    amnesiac_exact: float
    episodes: int  # of that measurement


@lru_cache(maxsize=64)
def committed(task: str) -> dict[str, Any]:
    """The certificate of a task as it was committed; empty if there is none."""
    file = files("hide_tasks").joinpath("certificates", f"{task}.json")
    return dict(json.loads(file.read_text())) if file.is_file() else {}


def certificate(task: str) -> Certificate | None:
    """The certificate in short; None if the task has none."""
    document = committed(task)
    if not document:
        return None
    measured = document["amnesiac"]
    return Certificate(
        task=task,
        verdict=document["verdict"],
        reason=document["reason"],
        ceiling_success=document["ceilings"]["success"],
        ceiling_exact=document["ceilings"]["exact"],
        amnesiac_success=measured["success"]["rate"],
        amnesiac_exact=measured["exact"]["rate"],
        episodes=measured["episodes"],
    )
