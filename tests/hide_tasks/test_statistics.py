import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from hide_tasks.statistics import Rate, wilson

counts = st.integers(1, 2000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts)
def test_the_interval_is_the_one_of_scipy(count: tuple[int, int]) -> None:
    expected = binomtest(*count).proportion_ci(method="wilson")

    assert wilson(*count) == pytest.approx((expected.low, expected.high), abs=1e-12)


@given(counts)
def test_the_interval_holds_the_rate(count: tuple[int, int]) -> None:
    low, high = Rate(*count).interval

    assert 0 <= low <= Rate(*count).value <= high <= 1


def test_without_episodes_nothing_is_known() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert math.isnan(Rate(0, 0).value)


def test_more_successes_than_episodes() -> None:
    with pytest.raises(ValueError, match="3 successes of 2 episodes"):
        wilson(3, 2)
