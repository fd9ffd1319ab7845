"""Reports that come twice, late, or of an attempt that is over change nothing."""

from typing import Any

import pytest

from tests.chaos.slow_network import LATE
from tests.chaos.systems import System
from tests.server.running import until


def test_every_result_comes_twice(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]]
) -> None:
    disturbed.hold("result.twice")

    evaluation = disturbed.ask()

    assert disturbed.finished(evaluation)["state"] == "completed"
    assert disturbed.lost(evaluation) == []
    assert disturbed.scores(evaluation) == undisturbed


@pytest.mark.parametrize("report", ["start", "result"])
def test_a_report_comes_when_another_attempt_has_finished(
    disturbed: System, undisturbed: dict[int, tuple[Any, ...]], report: str
) -> None:
    disturbed.hold(f"{report}.asked")
    evaluation = disturbed.ask()
    disturbed.holding(f"{report}.asked")
    disturbed.kill("supervisor")
    assert disturbed.finished(evaluation)["state"] == "completed"
    before = disturbed.committed()

    disturbed.release()
    until((disturbed.holds / LATE).exists, "the late report")

    assert disturbed.committed() == before
    assert disturbed.scores(evaluation) == undisturbed
    assert [one.reason for one in disturbed.lost(evaluation)] == ["its process died with signal 9"]
    assert disturbed.server.get(f"/evaluations/{evaluation}")["state"] == "completed"
