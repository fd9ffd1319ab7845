"""What stands still for a while goes on; what stands still for too long is replaced."""

import time
from typing import Any

import pytest

from tests.chaos.systems import System, cells, marks_of
from tests.processes import alive
from tests.server.running import until

A_WHILE = 3.0  # s
PARTS = {"pebble": ("supervisor", "server"), "dask": ("worker", "scheduler")}


@pytest.mark.parametrize(
    ("system", "part"),
    [cell for engine, parts in PARTS.items() for cell in cells(*parts, engine=engine)],
    indirect=["system"],
    scope="session",
)
def test_a_part_that_stands_still_for_a_while_goes_on(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]], part: str
) -> None:
    decides = disturbed.deciding()
    evaluation = disturbed.ask()
    until(decides, "a decision", 240)
    pid = until(lambda: disturbed.pid(part), part)

    disturbed.freeze(pid)
    time.sleep(A_WHILE)
    disturbed.thaw(pid)

    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.lost(evaluation) == []
    assert disturbed.scores(evaluation) == undisturbed


def test_everything_stands_still_for_a_while_as_a_laptop_does(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]]
) -> None:
    decides = disturbed.deciding()
    evaluation = disturbed.ask()
    until(decides, "a decision", 240)
    pids = disturbed.tree()

    disturbed.freeze(*pids)
    time.sleep(A_WHILE)
    disturbed.thaw(*pids)

    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.lost(evaluation) == []
    assert disturbed.scores(evaluation) == undisturbed


@pytest.mark.parametrize(
    "system", [pytest.param("pebble", marks=marks_of("pebble"))], indirect=True, scope="session"
)
def test_what_thaws_after_its_server_is_gone_ends_and_changes_nothing(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]]
) -> None:
    """A stopped process hears of no death, so it is there until it goes on."""
    decides = disturbed.deciding()
    evaluation = disturbed.ask()
    until(decides, "a decision", 240)
    frozen = until(lambda: disturbed.pid("supervisor"), "the supervisor")
    disturbed.freeze(frozen)
    disturbed.kill("server")

    done = disturbed.server.finished(evaluation)
    assert alive(frozen)
    disturbed.thaw(frozen)

    until(lambda: not disturbed.orphans(), "the end of what was frozen", 60)
    assert done["state"] == "completed"
    assert disturbed.scores(evaluation) == undisturbed
    assert {one.reason for one in disturbed.lost(evaluation)} == {"the server stopped"}
