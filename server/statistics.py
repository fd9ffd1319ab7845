"""What two policies' outcomes on the same episodes say of the difference between them.

Episodes are paired: the same scene, the same hidden history, two policies. What both or neither
manage says nothing of the difference; McNemar's test looks at the others. Every task has as many
episodes as every other, so flipping the signs of single episodes at random, which is the
permutation test of the mean over tasks, gives McNemar's exact distribution of the sums as well.

Two populations are meant by two bootstraps: other episodes of these tasks (`over_episodes`), and
other tasks like these (`over_tasks`).
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, stdtrit

from hide_tasks.statistics import wilson

METHOD = "mcnemar-midp,newcombe10,bootstrap10000,holm/1"  # changes when a figure would
REPLICATES = 10_000
SEED = 20_260  # of the bootstrap: the same episodes give the same interval
LEVEL = 0.05

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Table(NamedTuple):
    """Episodes by what two policies made of them."""

    both: int
    only_a: int
    only_b: int
    neither: int

    @property
    def episodes(self) -> int:
        """How many."""
        return sum(self)

    @property
    def difference(self) -> float:
        """Success rate of A less that of B; 0 without episodes."""
        return (self.only_a - self.only_b) / self.episodes if self.episodes else 0.0


def mcnemar(only_a: int | Ints, only_b: int | Ints, *, exact: bool = False) -> Floats:
    """Two-sided p-value that neither policy is better; arrays give one of each pair.

    The mid-p value keeps its level closely with few episodes; the exact one never exceeds it and
    finds less.

    Source: Fagerland, Lydersen and Laake 2013, BMC Medical Research Methodology 13:91.
    """
    a, b = np.asarray(only_a, dtype=np.int64), np.asarray(only_b, dtype=np.int64)
    few, n = np.minimum(a, b), a + b
    below = np.where(few > 0, bdtr(np.maximum(few - 1, 0), n, 0.5), 0.0)
    up_to = bdtr(few, n, 0.5)
    here = up_to - below
    mid = np.where(a == b, 1 - here / 2, 2 * up_to - here)
    found: Floats = np.minimum(1.0, 2 * up_to) if exact else np.where(n == 0, 1.0, mid)
    return found


def sign_flip(differences: Ints) -> float:
    """Two-sided mid-p-value that the episodes' differences are as often for as against.

    Args:
        differences: one per episode, whole numbers on any one scale; from several versions of a
            policy, those of the sums of their outcomes.

    The exact distribution of the sum when every sign is a coin's; for differences of one it is
    McNemar's test.
    """
    moved = np.abs(differences[differences != 0])
    if not len(moved):
        return 1.0
    unit = int(np.gcd.reduce(moved))
    sizes, counts = np.unique(moved // unit, return_counts=True)
    most = int(sizes @ counts)
    turns = 2 * np.pi * np.arange(2 * most + 1) / (2 * most + 1)
    waves = np.prod(np.cos(np.outer(turns, sizes)) ** counts, axis=1)
    chances = np.maximum(np.fft.fft(waves).real / len(turns), 0.0)  # of the sums 0, 1, … most
    reached = abs(int(differences.sum())) // unit
    beyond, here = 2 * chances[reached + 1 : most + 1].sum(), chances[reached]
    return float(min(1.0, beyond + (here if reached else here / 2)))


def interval(table: Table) -> tuple[float, float]:
    """95 % interval of the difference of two success rates on the same episodes.

    It also holds for few episodes and where none went differently; everything is possible
    without episodes.

    Source: Newcombe 1998, Statistics in Medicine 17:2635, method 10.
    """
    n = table.episodes
    if n == 0:
        return -1.0, 1.0
    a, b = table.both + table.only_a, table.both + table.only_b
    return _of_pair(a, b, n, _phi(table))


def interval_of_means(a: Ints, b: Ints) -> tuple[float, float]:
    """95 % interval of the difference of two mean success rates on the same episodes.

    Args:
        a, b: versions of a policy × episodes, 0 or 1.

    As `interval`, and the same for one version each: another version of a policy is no other
    episode. For several, the correlation is that of the episodes' means.
    """
    if len(a) == len(b) == 1:
        one, other = a[0] > 0, b[0] > 0
        counts = (one & other, one & ~other, ~one & other, ~one & ~other)
        return interval(Table(*(int(cell.sum()) for cell in counts)))
    means = a.mean(axis=0), b.mean(axis=0)
    told = all(np.ptp(one) > 0 for one in means)
    phi = float(np.corrcoef(*means)[0, 1]) if told else 0.0
    return _of_pair(float(means[0].sum()), float(means[1].sum()), a.shape[1], phi)


def of_shares(successes: float, episodes: int) -> tuple[float, float]:
    """Wilson's 95 % interval where an episode may be a success in part: by some versions of all.

    It is that of as many episodes, so it is never too narrow.
    """
    return wilson(min(successes, episodes), episodes)  # type: ignore[arg-type] # any number does


def _of_pair(a: float, b: float, n: int, phi: float) -> tuple[float, float]:
    (low_a, high_a), (low_b, high_b) = of_shares(a, n), of_shares(b, n)
    rate_a, rate_b, difference = a / n, b / n, (a - b) / n
    down, up = (rate_a - low_a, high_b - rate_b), (high_a - rate_a, rate_b - low_b)
    low = difference - sqrt(down[0] ** 2 - 2 * phi * down[0] * down[1] + down[1] ** 2)
    high = difference + sqrt(up[0] ** 2 - 2 * phi * up[0] * up[1] + up[1] ** 2)
    return max(-1.0, low), min(1.0, high)


def _phi(table: Table) -> float:
    """The correlation of the two outcomes, corrected downwards for small numbers."""
    both, only_a, only_b, neither = table
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    if margins == 0:
        return 0.0
    cross = both * neither - only_a * only_b
    corrected = max(cross - table.episodes / 2, 0.0) if cross > 0 else cross
    return corrected / sqrt(margins)


def over_episodes(tables: Sequence[Table]) -> tuple[float, float] | None:
    """95 % interval of the mean difference over tasks, for other episodes of the same tasks.

    Episodes are drawn again within each task. None if no episode went differently: there is
    nothing to draw a difference from.
    """
    if not _tells(tables):
        return None
    random = np.random.default_rng(SEED)
    drawn = [
        _differences(random.multinomial(one.episodes, _shares(one), size=REPLICATES))
        for one in tables
    ]
    return _percentiles(np.mean(drawn, axis=0))


def over_tasks(tables: Sequence[Table]) -> tuple[float, float] | None:
    """95 % interval of the mean difference over tasks, for other tasks like these.

    Tasks are drawn again, then episodes within each. None for fewer than two tasks, and if no
    episode went differently.
    """
    if len(tables) < 2 or not _tells(tables):
        return None
    random = np.random.default_rng(SEED)
    which = random.integers(len(tables), size=(REPLICATES, len(tables)))
    shares = np.array([_shares(one) for one in tables])[which]
    episodes = np.array([one.episodes for one in tables])[which]
    return _percentiles(_differences(random.multinomial(episodes, shares)).mean(axis=1))


def _tells(tables: Sequence[Table]) -> bool:
    return all(one.episodes for one in tables) and any(one.only_a + one.only_b for one in tables)


def _shares(table: Table) -> Floats:
    """How many episodes went to A, to B, and to neither of the two alone."""
    found = np.array([table.only_a, table.only_b, table.both + table.neither], dtype=np.float64)
    return found / table.episodes


def _differences(drawn: Ints) -> Floats:
    found: Floats = (drawn[..., 0] - drawn[..., 1]) / drawn.sum(axis=-1)
    return found


def _percentiles(drawn: Floats) -> tuple[float, float]:
    low, high = np.quantile(drawn, [LEVEL / 2, 1 - LEVEL / 2])
    return float(low), float(high)


def of_mean(values: Sequence[float]) -> tuple[float, float] | None:
    """95 % interval of a mean, by Student's t; None for fewer than two values."""
    count = len(values)
    if count < 2:
        return None
    mean, spread = float(np.mean(values)), float(np.std(values, ddof=1))
    half = float(stdtrit(count - 1, 1 - LEVEL / 2)) * spread / sqrt(count)
    return mean - half, mean + half


def holm(values: Sequence[float] | Floats) -> Floats:
    """P-values of several tests at once, adjusted so that one false alarm is as rare as of one.

    Source: Holm 1979, Scandinavian Journal of Statistics 6:65.
    """
    found = np.asarray(values, dtype=np.float64)
    order = np.argsort(found, kind="stable")
    steps = np.arange(len(found), 0, -1)
    raised = np.minimum(1.0, np.maximum.accumulate(steps * found[order]))
    adjusted = np.empty_like(raised)
    adjusted[order] = raised
    return adjusted


def rank_sets(outcomes: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """The best and the worst rank that each policy may have, together with 95 % confidence.

    Args:
        outcomes: policies × episodes, the same episodes in the same order.

    A policy ranks behind those that are shown to be better and before those that are shown to be
    worse, by McNemar's test of every pair with Holm's correction over all pairs.

    Source: Mogstad, Romano, Shaikh and Wilhelm 2024, Review of Economic Studies 91:476.
    """
    count = len(outcomes)
    if count < 2:
        return [(1, 1)] * count
    good = outcomes.astype(np.float32)  # exact for so few episodes, and multiplied fast
    wins = (good @ (1 - good).T).round().astype(np.int64)
    rows, columns = np.triu_indices(count, k=1)
    shown = holm(mcnemar(wins[rows, columns], wins[columns, rows])) <= LEVEL
    better = np.zeros((count, count), dtype=bool)
    better[rows, columns] = shown & (wins[rows, columns] > wins[columns, rows])
    better[columns, rows] = shown & (wins[columns, rows] > wins[rows, columns])
    behind, ahead = better.sum(axis=0), better.sum(axis=1)
    return [(1 + int(b), count - int(a)) for b, a in zip(behind, ahead, strict=True)]
