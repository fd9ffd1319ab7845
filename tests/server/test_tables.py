from io import StringIO

import pytest
from rich.console import Console

from hide_tasks.contract import EpisodeResult, Failure
from hide_tasks.statistics import Rate
from server.tables import by_category, by_task, percent, results_table, summed
from tests.workers.test_run_folder import TASKS, result, wanted
from workers.results import Results


def failed(task: str, index: int, failure: Failure, *, success: bool = False) -> EpisodeResult:
    fields = {"success": success, "exact": False, "failure": failure}
    return result(task, index).model_copy(update=fields)


def results() -> Results:
    results = wanted()
    for episode in (
        result(TASKS[0], 0),
        failed(TASKS[0], 1, Failure.UNDERCOUNT),
        failed(TASKS[0], 2, Failure.OVERCOUNT, success=True),
        failed(TASKS[1], 0, Failure.REPEATED_STEP),
        failed(TASKS[1], 1, Failure.REPEATED_STEP),
    ):
        results = results.with_episode(episode)
    return results


def test_a_row_counts_both_verdicts_and_the_most_frequent_failure() -> None:
    count, search = by_task(results())

    assert (count.success, count.exact, count.coverage) == (Rate(2, 3), Rate(1, 3), "3")
    assert count.common_failure == "overcount 1"
    assert (search.coverage, search.common_failure) == ("2 of 3", "repeated_step 2")


def test_categories_and_the_whole_are_over_episodes() -> None:
    rows = by_task(results())

    assert [(row.name, row.success) for row in by_category(rows)] == [
        ("RC", Rate(2, 3)),
        ("EPT", Rate(0, 2)),
    ]
    assert summed("overall", rows).success == Rate(2, 5)


@pytest.mark.parametrize(
    ("rate", "text"),
    [
        (Rate(25, 25), "100 % [86, 100]"),
        (Rate(0, 25), "  0 %   [0, 14]"),
        (Rate(24, 25), " 96 %  [80, 100]"),
        (Rate(0, 0), "–"),
    ],
)
def test_a_rate_is_never_without_its_interval(rate: Rate, text: str) -> None:
    assert percent(rate).split() == text.split()


def test_the_table_holds_every_number() -> None:
    console = Console(width=160, record=True, file=StringIO())

    console.print(results_table(results()))

    lines = console.export_text().splitlines()
    [line] = [line for line in lines if "push_button_times" in line]
    assert " ".join(line.split()) == (
        "RC push_button_times 67 % [20, 94] 33 % [6, 80] 3 overcount 1"
    )
    [whole] = [line for line in lines if "overall" in line]
    assert "40 %" in whole
    assert "5 of 6" in whole
