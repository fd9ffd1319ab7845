"""An episode played without memory, once for every way in which its choices can fall.

The simulator repeats itself, so what such a policy reaches depends on what it picks where the
choice is open, and on nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hide_tasks import suite
from hide_tasks.amnesiac import Amnesiac, Options, options
from hide_tasks.contract import Action, EpisodeResult, EpisodeSpec, Observation
from hide_tasks.episode import play
from hide_tasks.script import Point

Path = tuple[str, ...]  # what was picked at the crossings so far


@dataclass
class Choices:
    """The plays of one episode so far, by what was picked."""

    spec: EpisodeSpec
    points: Sequence[Point]
    crossings: dict[Path, tuple[Options, Observation]] = field(default_factory=dict)
    results: dict[Path, EpisodeResult] = field(default_factory=dict)

    def play(self, policy: Amnesiac) -> EpisodeResult:
        """What a policy that knows the episode reaches; played only if it picks anew."""
        policy.reset("", suite.policy_seed(self.spec))
        path: Path = ()
        while path in self.crossings:
            path = (*path, policy.pick(*self.crossings[path]))
        if path not in self.results:
            guided = _Guided(self, policy, path)
            result, _ = play(self.spec, guided)
            path = guided.path
            self.results[path] = result
        return self.results[path]


class _Guided:
    """Takes the picks that it is given, then asks the policy; notes every crossing."""

    def __init__(self, choices: Choices, policy: Amnesiac, given: Path):
        self.choices, self.policy, self.given = choices, policy, given
        self.path: Path = ()

    def reset(self, instruction: str, policy_seed: int) -> None:
        """The policy has been told."""

    def act(self, observation: Observation) -> Action:
        found = options(self.choices.points, observation)
        if len(found) == 1:
            return next(iter(found.values())).next
        self.choices.crossings[self.path] = found, observation
        ahead = self.given[len(self.path) :]
        name = ahead[0] if ahead else self.policy.pick(found, observation)
        self.path = (*self.path, name)
        return found[name].next
