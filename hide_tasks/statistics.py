"""Intervals for success rates of few episodes."""

from math import sqrt
from typing import NamedTuple

Z = 1.959963984540054  # two-sided 95 %


class Rate(NamedTuple):
    """Successes among episodes, with the 95 % Wilson interval of the success rate."""

    successes: int
    episodes: int

    @property
    def value(self) -> float:
        """0 to 1; not a number without episodes."""
        return self.successes / self.episodes if self.episodes else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """(low, high), 0 to 1; everything is possible without episodes."""
        return wilson(self.successes, self.episodes)


def wilson(successes: int, episodes: int, z: float = Z) -> tuple[float, float]:
    """The Wilson score interval of a success rate.

    Raises:
        ValueError: there are more successes than episodes, or a negative number of either.
    Source: Wilson 1927; Brown, Cai and DasGupta 2001 recommend it for small numbers.
    """
    if not 0 <= successes <= episodes:
        raise ValueError(f"{successes} successes of {episodes} episodes; expected 0 to {episodes}.")
    if episodes == 0:
        return 0.0, 1.0
    rate, shrink = successes / episodes, 1 + z * z / episodes
    centre = (rate + z * z / (2 * episodes)) / shrink
    half = z * sqrt(rate * (1 - rate) / episodes + (z / (2 * episodes)) ** 2) / shrink
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == episodes else centre + half
    return low, high
