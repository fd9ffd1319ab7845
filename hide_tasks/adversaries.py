"""Policies that look for a way to score without memory. None may beat a certified ceiling.

They have the amnesiac's perfect perception and skills, and choose by a rule instead of the
certificate's odds.
"""

from hide_tasks.amnesiac import Amnesiac, Options, matching
from hide_tasks.contract import Action, Observation, Stop
from hide_tasks.script import same_action


class Searches(Amnesiac):
    """Picks any of the candidates: random search with perfect skills."""

    def pick(self, found: Options, observation: Observation) -> str:
        """One of them, each as likely as any other."""
        return str(self.rng.choice(list(found)))


class GoesOn(Amnesiac):
    """Never ends while something else can be done: presses for ever."""

    def pick(self, found: Options, observation: Observation) -> str:
        """The first candidate that is not in the last stage of a script."""
        last = {point.stage for point in self.points if point.next.stop}
        going = [name for name, point in found.items() if point.stage not in last]
        return (going or list(found))[0]


class MostCommon(Amnesiac):
    """Does what is right most often where the present looks like this."""

    def pick(self, found: Options, observation: Observation) -> str:
        """The candidate that most of the matching moments of all histories call for."""
        there = matching(self.points, observation)
        votes = {
            name: sum(same_action(option.next, point.next) for point in there)
            for name, option in found.items()
        }
        return max(votes, key=lambda name: votes[name])


class StopsAtOnce:
    """Says that it is done before it did anything."""

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Action:
        """The end."""
        return Stop()


CHOOSERS: dict[str, type[Amnesiac]] = {
    "goes_on": GoesOn,
    "searches": Searches,
    "most_common": MostCommon,
}
ADVERSARIES = (*CHOOSERS, "stops_at_once")
