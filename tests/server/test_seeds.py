"""What several trainings say of other trainings."""

import numpy as np
import pytest

from server import seeds
from server.statistics import Table, over_episodes

TASKS = ["press"] * 40 + ["search"] * 40


def outcomes(*rates: float) -> np.ndarray:
    """A seed for each rate; the same episodes are the easy ones for all."""
    ease = np.tile(np.arange(40) / 40, 2)
    return np.array([ease < rate for rate in rates], dtype=np.int64)


def test_one_seed_says_of_episodes_alone() -> None:
    [low, high] = seeds.interval(outcomes(0.5), TASKS) or (0, 0)

    assert low == pytest.approx(0.5 - 1.96 * np.sqrt(0.25 / 80), abs=0.01)
    assert high == pytest.approx(0.5 + 1.96 * np.sqrt(0.25 / 80), abs=0.01)


def test_seeds_that_differ_widen_the_interval() -> None:
    alike, apart = (seeds.interval(outcomes(*rates), TASKS) or (0, 0)
                    for rates in ((0.5, 0.5, 0.5), (0.2, 0.5, 0.8)))  # fmt: skip

    assert apart[1] - apart[0] > 1.5 * (alike[1] - alike[0])


def test_a_difference_of_single_seeds_is_that_of_paired_episodes() -> None:
    a, b = outcomes(0.8), outcomes(0.4)
    tables = [Table(16, 16, 0, 8)] * 2  # of each task

    assert seeds.interval(a, TASKS, b) == pytest.approx(over_episodes(tables), abs=0.015)


def test_episodes_are_drawn_within_their_tasks() -> None:
    """All of one task and none of the other: other episodes change nothing."""
    good = np.array([[1] * 40 + [0] * 40])

    assert seeds.interval(good, TASKS) is None


def test_the_same_outcomes_give_the_same_interval() -> None:
    assert seeds.interval(outcomes(0.3, 0.6), TASKS) == seeds.interval(outcomes(0.3, 0.6), TASKS)
