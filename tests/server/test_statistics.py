"""Paired statistics: published figures, exact enumeration, and laws."""

from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.statistics import (
    Table,
    holm,
    interval,
    interval_of_means,
    mcnemar,
    of_mean,
    over_episodes,
    over_tasks,
    rank_sets,
    sign_flip,
)

counts = st.integers(0, 30)
tables = st.builds(Table, counts, counts, counts, counts)


@pytest.mark.parametrize(
    ("a", "b", "exact", "mid"),
    [(6, 0, 0.031, 0.016), (5, 0, 0.062, 0.031), (8, 2, 0.109, 0.065), (0, 0, 1.0, 1.0),
     (3, 3, 1.0, 1 - 20 / 64 / 2)],
)  # fmt: skip
def test_mcnemar_of_known_tables(a: int, b: int, exact: float, mid: float) -> None:
    assert mcnemar(a, b, exact=True) == pytest.approx(exact, abs=6e-4)
    assert mcnemar(a, b) == pytest.approx(mid, abs=6e-4)


def test_a_published_example() -> None:
    """Cavo et al. 2012, as Fagerland, Lydersen and Laake analyse it (2017, chapter 8)."""
    table = Table(59, 6, 16, 80)

    assert mcnemar(6, 16, exact=True) == pytest.approx(0.052479, abs=5e-7)
    assert mcnemar(6, 16) == pytest.approx(0.034690, abs=5e-7)
    assert table.difference == pytest.approx(-0.0621, abs=5e-5)
    assert interval(table) == pytest.approx((-0.1186, -0.0046), abs=5e-5)
    assert interval(Table(36, 12, 2, 0)) == pytest.approx((0.0569, 0.3404), abs=5e-5)  # Newcombe


@given(counts, counts)
def test_the_exact_p_value_is_the_share_of_coin_tosses_as_far_out(a: int, b: int) -> None:
    n = a + b
    far = sum(comb(n, k) for k in range(n + 1) if abs(2 * k - n) >= abs(a - b))

    assert mcnemar(a, b, exact=True) == pytest.approx(far / 2**n)
    assert mcnemar(a, b) == pytest.approx(mcnemar(b, a))
    assert mcnemar(a, b) <= mcnemar(a, b, exact=True)


def test_p_values_of_arrays_are_those_of_their_pairs() -> None:
    a, b = np.array([6, 5, 8, 0, 3]), np.array([0, 0, 2, 0, 3])

    assert mcnemar(a, b).tolist() == [float(mcnemar(x, y)) for x, y in zip(a, b, strict=True)]


def test_flipping_the_signs_of_episodes_gives_the_exact_test() -> None:
    """Eight episodes of two tasks; all 256 signs of the mean over tasks."""
    signs = np.array([1, 1, -1, 0, 1, 0, 1, 1])
    seen = abs(signs[:4].mean() + signs[4:].mean())
    flipped = [np.array(flip) * signs for flip in product([1, -1], repeat=8)]
    far = [abs(one[:4].mean() + one[4:].mean()) >= seen - 1e-12 for one in flipped]

    assert mcnemar(5, 1, exact=True) == pytest.approx(np.mean(far))


@pytest.mark.parametrize(
    ("rates", "correlation"),
    [((0.5, 0.5), 0.5), ((0.8, 0.5), 0.0), ((0.6, 0.6), 0.2), ((0.3, 0.6), 0.3)],
)
def test_the_interval_covers_as_often_as_it_says(
    rates: tuple[float, float], correlation: float
) -> None:
    """All outcomes of 15 episodes, weighed by how likely they are."""
    a, b = rates
    both = a * b + correlation * (a * (1 - a) * b * (1 - b)) ** 0.5
    shares = [both, a - both, b - both, 1 - a - b + both]
    assert min(shares) >= 0
    covered = sum(
        _chance(table, shares)
        for table in _every_table(15)
        if (found := interval(table))[0] - 1e-12 <= a - b <= found[1] + 1e-12
    )

    assert 0.93 < covered < 0.995


def _every_table(n: int) -> list[Table]:
    return [
        Table(x, y, z, n - x - y - z)
        for x in range(n + 1)
        for y in range(n + 1 - x)
        for z in range(n + 1 - x - y)
    ]


def _chance(table: Table, shares: list[float]) -> float:
    ways, left = 1, table.episodes
    for count in table:
        ways, left = ways * comb(left, count), left - count
    found: float = ways * np.prod([p**k for p, k in zip(shares, table, strict=True)])
    return found


@given(tables)
def test_the_interval_holds_the_difference_and_turns_with_it(table: Table) -> None:
    low, high = interval(table)
    turned = Table(table.both, table.only_b, table.only_a, table.neither)

    assert -1 <= low <= table.difference <= high <= 1
    assert interval(turned) == pytest.approx((-high, -low))


def test_an_interval_of_nothing_different_is_not_a_point() -> None:
    low, high = interval(Table(25, 0, 0, 0))

    assert low < -0.1 and high > 0.1
    assert over_episodes([Table(25, 0, 0, 0)] * 3) is None
    assert over_tasks([Table(25, 0, 0, 0)] * 3) is None


def test_one_task_says_nothing_of_others() -> None:
    assert over_tasks([Table(10, 9, 1, 5)]) is None
    assert over_episodes([Table(10, 9, 1, 5)]) is not None


def test_the_bootstrap_over_episodes_is_the_normal_one_of_many() -> None:
    tables = [Table(10, 8, 2, 5), Table(5, 10, 5, 5), Table(0, 12, 1, 12)]
    variance = (
        sum(((one.only_a + one.only_b) / 25 - one.difference**2) / 25 for one in tables)
        / len(tables) ** 2
    )
    mean = float(np.mean([one.difference for one in tables]))

    low, high = over_episodes(tables) or (0, 0)

    assert low == pytest.approx(mean - 1.96 * variance**0.5, abs=0.015)
    assert high == pytest.approx(mean + 1.96 * variance**0.5, abs=0.015)


def test_tasks_that_differ_widen_the_interval_over_tasks_alone() -> None:
    uneven = [Table(0, 25, 0, 0), Table(0, 0, 0, 25), Table(0, 12, 13, 0), Table(5, 10, 5, 5)]

    (low, high), (lower, higher) = over_episodes(uneven) or (0, 0), over_tasks(uneven) or (0, 0)

    assert lower < low and high < higher


def test_the_same_episodes_give_the_same_interval() -> None:
    tables = [Table(10, 8, 2, 5), Table(5, 10, 5, 5)]

    assert over_episodes(tables) == over_episodes(tables)
    assert over_tasks(tables) == over_tasks(tables)


def test_holm_of_a_known_example() -> None:
    """Four tests: times 4, 3, 2, 1 in their order, never falling."""
    assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]).tolist() == [1.0, 1.0]
    assert holm([]).tolist() == []


def outcomes(*rates: float, episodes: int = 100) -> np.ndarray:
    """Policies that succeed in their first so many episodes."""
    return np.array([[n < round(rate * episodes) for n in range(episodes)] for rate in rates])


def test_policies_that_cannot_be_told_apart_share_their_ranks() -> None:
    assert rank_sets(outcomes(0.9, 0.88, 0.3)) == [(1, 2), (1, 2), (3, 3)]


def test_ranks_follow_policies_not_their_order() -> None:
    assert rank_sets(outcomes(0.1, 0.9, 0.5)) == [(3, 3), (1, 1), (2, 2)]


def test_a_policy_between_two_that_differ_may_be_like_both() -> None:
    assert rank_sets(outcomes(0.60, 0.55, 0.50)) == [(1, 2), (1, 3), (2, 3)]


def test_ranks_of_none_and_of_one() -> None:
    assert rank_sets(outcomes(0.5)) == [(1, 1)]
    assert rank_sets(np.zeros((0, 5), dtype=bool)) == []


def test_policies_without_a_difference_seldom_get_different_ranks() -> None:
    random = np.random.default_rng(0)
    told = [rank_sets(random.random((4, 375)) < 0.5) for _ in range(200)]

    assert sum(one != [(1, 4)] * 4 for one in told) <= 20  # 5 % of 200, and chance


# --- several versions of a policy on the same episodes ---


@pytest.mark.parametrize(("a", "b"), [(0, 0), (1, 0), (6, 0), (8, 2), (5, 5), (33, 102)])
def test_flipped_signs_of_single_versions_are_mcnemars_test(a: int, b: int) -> None:
    differences = np.array([1] * a + [-1] * b + [0] * 20)

    assert sign_flip(differences) == pytest.approx(float(mcnemar(a, b)), abs=1e-12)
    assert sign_flip(3 * differences) == sign_flip(differences) == sign_flip(-differences)


@pytest.mark.parametrize("differences", [[3, 1, 1, -2], [2, 2, -1], [5, -5, 1], [4, 4, 4, 4, -1]])
def test_flipped_signs_are_the_share_of_all_ways_to_flip_them(differences: list[int]) -> None:
    sums = [
        abs(sum(sign * one for sign, one in zip(signs, differences, strict=True)))
        for signs in product((-1, 1), repeat=len(differences))
    ]
    reached = abs(sum(differences))
    share = [np.mean([one > reached for one in sums]), np.mean([one == reached for one in sums])]

    assert sign_flip(np.array(differences)) == pytest.approx(share[0] + share[1] / 2)


def test_the_interval_of_single_versions_is_that_of_their_table() -> None:
    random = np.random.default_rng(0)
    a, b = random.integers(2, size=(2, 1, 60))

    table = Table(*(int(((a == x) & (b == y)).sum()) for x in (1, 0) for y in (1, 0)))

    assert interval_of_means(a, b) == interval(table)


def test_more_versions_of_the_same_outcomes_say_no_more() -> None:
    random = np.random.default_rng(1)
    a, b = random.integers(2, size=(2, 1, 80))

    one, five = interval_of_means(a, b), interval_of_means(np.repeat(a, 5, 0), b)

    assert five == pytest.approx(one, abs=0.01)
    assert sign_flip((5 * a - 5 * b).sum(0)) == sign_flip((a - b).sum(0))


def test_what_one_manages_and_the_other_does_not_widens_the_interval_of_several_versions() -> None:
    a = np.array([[1] * 40 + [0] * 40 + [1] * 5 + [0] * 5])
    b = np.array([[0] * 40 + [1] * 40 + [1] * 5 + [0] * 5])

    one, two = interval_of_means(a, b), interval_of_means(np.repeat(a, 2, 0), b)

    assert two == pytest.approx(one, abs=0.005)


def test_the_interval_of_a_mean_is_students() -> None:
    assert of_mean([1]) is None and of_mean([]) is None
    assert of_mean([2, 2, 2]) == (2.0, 2.0)
    assert of_mean([1, 2, 3, 4, 5]) == pytest.approx((1.0368, 4.9632), abs=1e-4)
