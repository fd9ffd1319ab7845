"""Those who record an episode, and how long they take over it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.scene import Part
from hide_tasks.contract import DecisionRecord, EpisodeResult, EpisodeSpec, Observation, Start


class Witness(Protocol):
    """Whoever records an episode."""

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence[Part], start: Start
    ) -> None:
        """The episode starts; `parts` is what will be drawn."""

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """20 times a simulated second: the world transforms (n, 4, 4) of the parts."""

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """The observation before an action and the record after it."""

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """The verdict and the last picture."""


class Audience:
    """Several witnesses as one, timed."""

    def __init__(self, witnesses: Sequence[Witness]):
        self.witnesses = witnesses
        self.seconds = 0.0  # that they took

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence[Part], start: Start
    ) -> None:
        """Tell all that the episode starts."""
        with self._timed():
            for witness in self.witnesses:
                witness.begin(spec, instruction, parts, start)

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Show all where the parts are."""
        with self._timed():
            for witness in self.witnesses:
                witness.frame(time, poses)

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """Tell all of a decision."""
        with self._timed():
            for witness in self.witnesses:
                witness.decided(observation, record)

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """Tell all the verdict."""
        with self._timed():
            for witness in self.witnesses:
                witness.end(result, observation)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        start = perf_counter()
        yield
        self.seconds += perf_counter() - start
