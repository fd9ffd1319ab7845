"""Policies that look for a way to score without memory. None may beat a certified ceiling.

They have the amnesiac's perfect perception and skills, and choose by a rule instead of the
certificate's odds.
"""

from collections.abc import Sequence

import numpy as np

from hide_tasks.amnesiac import Amnesiac, matching, options
from hide_tasks.contract import Action, Observation, Stop
from hide_tasks.script import same_action


class Searches(Amnesiac):
    """Picks any of the candidates: random search with perfect skills."""

    def choose(self, names: Sequence[str]) -> str:
        """One of them, each as likely as any other."""
        return str(self.rng.choice(names))


class GoesOn(Amnesiac):
    """Never ends while something else can be done: presses for ever."""

    def act(self, observation: Observation) -> Action:
        """The first candidate that is not the last keyframe of its script, nor its last stage."""
        found = options(self.points, observation)
        last = {point.stage for point in self.points if point.next.stop}
        going = [point for point in found.values() if point.stage not in last]
        return (going or list(found.values()))[0].next


class MostCommon(Amnesiac):
    """Does what is right most often where the present looks like this."""

    def act(self, observation: Observation) -> Action:
        """The candidate that most of the matching moments of all histories call for."""
        there = matching(self.points, observation)
        votes = [sum(same_action(point.next, other.next) for other in there) for point in there]
        return there[int(np.argmax(votes))].next


class StopsAtOnce:
    """Says that it is done before it did anything."""

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Action:
        """The end."""
        return Stop()


ADVERSARIES = {
    "goes_on": GoesOn,
    "searches": Searches,
    "most_common": MostCommon,
    "stops_at_once": StopsAtOnce,
}
