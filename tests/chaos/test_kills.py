"""Whatever is killed, whenever: every episode is final once, as in an undisturbed run."""

import re
from typing import Any

import pytest

from tests.chaos.systems import MOMENTS, System, cells
from tests.server.running import until

# By moment, the report that is held back then.
HOLDS = dict(zip(MOMENTS, ("start.asked", None, "result.answered"), strict=True))
REASONS = {  # of attempts that are lost; none need be
    "policy": "1 of 2 episodes could not be played: .* before it served",
    "simulator": "1 of 2 episodes could not be played: .*the simulator's process died: signal 9",
    "supervisor": "its process died with signal 9",
    "worker": "its worker disappeared",
    "scheduler": "the scheduler lost it",
    "server": "the server stopped",
}


def strike(system: System, victim: str, moment: str) -> str:
    """The id of an evaluation in which a part was killed at this moment."""
    decides = system.deciding()
    if hold := HOLDS[moment]:
        system.hold(hold)
    evaluation = system.ask(recordings=not hold)
    if hold:
        system.holding(hold)
    else:
        until(decides, "a decision", 240)
    if victim == "policy" and moment == MOMENTS[0]:
        system.release()  # it is there only then, and killed while it is loaded
    system.kill(victim)
    system.release()
    return evaluation


def is_tried(engine: str, victim: str, moment: str) -> bool:
    """Below a machine of a cluster runs what runs below a server; that is tried in full there."""
    return engine == "pebble" or victim not in ("policy", "simulator") or moment == MOMENTS[1]


@pytest.mark.parametrize(
    ("system", "victim", "moment"),
    [
        pytest.param(*cell.values, moment, marks=cell.marks)
        for cell in cells(*REASONS)
        for moment in MOMENTS
        if is_tried(*cell.values, moment)
    ],
    indirect=["system"],
    scope="session",
)
def test_a_part_is_killed(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]], victim: str, moment: str
) -> None:
    evaluation = strike(disturbed, victim, moment)

    done = disturbed.finished(evaluation)
    assert (done["state"], done["reason"]) == ("completed", None)
    assert disturbed.scores(evaluation) == undisturbed
    for one in disturbed.lost(evaluation):
        assert re.search(REASONS[victim], one.reason)
