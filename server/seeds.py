"""Several trainings of one model: how far its score would move with other seeds and episodes.

`server.statistics` has what one version says of other episodes. A training's seed is a draw as
well, and all seeds play the same episodes, so both are drawn again, crossed: seeds with all that
they played; episodes, within their tasks, for all seeds at once. Three seeds say little of other
seeds: a bootstrap over so few is narrower than it should be.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from server.statistics import LEVEL, REPLICATES, SEED

METHOD = "bootstrap10000 of seeds × episodes within tasks/1"  # changes when a figure would

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def interval(a: Ints, tasks: Sequence[str], b: Ints | None = None) -> tuple[float, float] | None:
    """95 % interval of a mean success rate, or of how much it is above another's.

    Args:
        a: seeds × episodes, 0 or 1.
        tasks: the task of each episode.
        b: another model's, on the same episodes; its seeds are drawn for themselves.

    None if there is nothing to draw a difference from: every seed made the same of all episodes.
    """
    random = np.random.default_rng(SEED)
    weights = _episodes(random, tasks)
    drawn = _drawn(random, a, weights)
    if b is not None:
        drawn = drawn - _drawn(random, b, weights)
    if np.ptp(drawn) == 0:
        return None
    low, high = np.quantile(drawn, [LEVEL / 2, 1 - LEVEL / 2])
    return float(low), float(high)


def _episodes(random: np.random.Generator, tasks: Sequence[str]) -> Floats:
    """Replicates × episodes: how often each is drawn; each task keeps its number."""
    names = np.array(tasks)
    weights = np.zeros((REPLICATES, len(names)))
    for name in dict.fromkeys(tasks):
        [of_task] = np.nonzero(names == name)
        count = len(of_task)
        weights[:, of_task] = random.multinomial(count, np.full(count, 1 / count), REPLICATES)
    return weights


def _drawn(random: np.random.Generator, good: Ints, weights: Floats) -> Floats:
    """The mean rate in each replicate."""
    seeds, episodes = good.shape
    chosen = random.multinomial(seeds, np.full(seeds, 1 / seeds), REPLICATES)
    drawn: Floats = (chosen * (weights @ good.T)).sum(axis=1) / (seeds * episodes)
    return drawn
