"""The normalised score: 0 at the ceiling, 1 at all, over the tasks that tell something."""

import pytest

from hide_tasks import SUITES
from server import leaderboard
from server.normalised import counting, normalised
from server.schemas.common import RatePublic, Verdicts

COLUMNS = leaderboard.columns()


def played(successes: int, episodes: int = 100) -> dict[str, Verdicts]:
    rate = RatePublic.of(successes, episodes)
    return {task: Verdicts(success=rate, exact=rate) for task in SUITES["hide"]}


def test_tasks_count_that_are_certified_and_leave_room() -> None:
    proofs = {one.task: one.certificate for one in COLUMNS}

    by_success, by_exact = counting(COLUMNS, "success"), counting(COLUMNS, "exact")

    assert all(proofs[task].verdict == "strong" for task in {*by_success, *by_exact})  # type: ignore[union-attr]
    assert "stack_blocks" not in by_exact  # weak: loose blocks can be counted
    assert set(by_exact) - set(by_success) == {
        "swap_square_pegs"
    }  # which only exactly needs memory
    assert all(ceiling < 1 for ceiling in by_success.values())


@pytest.mark.parametrize(("rate", "value"), [(100, 1.0), (60, 0.2), (50, 0.0), (0, -1.0)])
def test_it_is_what_lies_above_the_ceiling(rate: int, value: float) -> None:
    found = normalised(played(rate), {"search_drawer": 0.25, "pour_put_back": 0.75}, "success")

    assert found is not None and found.value == pytest.approx(value)
    assert found.episodes == 200 and found.low <= found.value <= found.high


def test_it_needs_every_task_that_counts() -> None:
    assert normalised({}, {"search_drawer": 0.25}, "success") is None
    assert normalised(played(1), {}, "success") is None
