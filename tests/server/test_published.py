"""The paper's main table is kept as it is printed, and its averages agree with its figures."""

from statistics import fmean

import pytest

from hide_tasks import SUITES
from server.latex import COLUMNS
from server.published import EPISODES, published
from server.schemas.leaderboard import PublishedRow

HALF = 0.05 + 1e-9  # a printed average has one digit behind the point
ROWS = {row.method: row for row in published().rows}


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_the_averages_of_the_paper_agree_with_its_figures(row: PublishedRow) -> None:
    for kind, tasks in COLUMNS.items():
        assert row.categories[kind] == pytest.approx(
            fmean(row.tasks[one] for one in tasks), abs=HALF
        )
    assert row.overall == pytest.approx(fmean(row.tasks.values()), abs=HALF)


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_every_figure_is_a_number_of_episodes(row: PublishedRow) -> None:
    assert set(row.tasks) == set(SUITES["hide"])
    assert all((value * EPISODES / 100).is_integer() for value in row.tasks.values())


def test_the_figures_are_those_that_the_paper_speaks_of() -> None:
    seek, other = ROWS["SEEK"], ROWS["SAM2Act+"]

    assert len(ROWS) == 12 and [row.method for row in ROWS.values() if row.memory_based] == [
        "μVLA",
        "MME",
        "SAM2Act+",
        "SEEK",
    ]
    assert round(seek.overall - other.overall, 1) == 11.7
    best = {
        kind: max(one.categories[kind] for one in ROWS.values() if one is not seek)
        for kind in COLUMNS
    }
    gains = {kind: round(seek.categories[kind] - best[kind], 1) for kind in COLUMNS}
    assert gains == {"RC": 15.2, "HSR": 9.6, "EPT": 7.2}
    assert (seek.tasks["push_button_times"], seek.tasks["swap_square_pegs"]) == (92, 92)
