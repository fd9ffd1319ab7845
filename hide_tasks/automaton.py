"""What can happen to a policy without memory, found out in the simulator.

Where the present looks like several script points with different next keyframes, such a policy
can only choose by fixed odds. Those places, and where each choice leads, form a small automaton:
it is explored by playing every choice once; `mixing.py` computes the best odds from it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, NamedTuple

from hide_tasks.amnesiac import Mix, odds, options
from hide_tasks.bullet.world import World
from hide_tasks.contract import Action, EpisodeSpec, Observation
from hide_tasks.episode import play
from hide_tasks.script import Point

Verdict = Literal["success", "exact"]


class Crossing(NamedTuple):
    """A place where the choice is open: the options, the hidden state, what is spoiled.

    The options' names tell where in their stages they are, and so places that look different apart.
    """

    options: tuple[str, ...]
    state: str


class Road(NamedTuple):
    """What follows a choice, up to the next crossing or the end."""

    decisions: int
    success_after: int | None  # decisions; None if it does not come before the next crossing
    exact: bool  # of the whole episode, if it ends here
    end: Crossing | None

    def worth(self, used: int, verdict: Verdict, budget: int) -> float | None:
        """1 if the verdict is reached on it, 0 if never; None while that is open.

        `used` is the number of decisions before it.
        """
        if self.success_after is not None and verdict == "success":
            return float(used + self.success_after <= budget)
        if self.end is None:
            return float(self.exact and used + (self.success_after or 0) <= budget)
        return 0.0 if used + self.decisions >= budget else None


@dataclass
class Automaton:
    """All roads of one truth."""

    start: Road
    roads: dict[tuple[Crossing, str], Road] = field(default_factory=dict)

    def value(self, mix: Mix, verdict: Verdict, budget: int) -> float:
        """The probability of a verdict within the budget, by fixed odds."""
        known: dict[tuple[Crossing, int], float] = {}

        @cache
        def chances(names: tuple[str, ...]) -> list[float]:
            return [float(value) for value in odds(mix, names)]

        def along(road: Road, used: int) -> float:
            worth = road.worth(used, verdict, budget)
            if worth is None:
                assert road.end is not None, "a road that is worth nothing yet leads on"
                return at(road.end, used + road.decisions)
            return worth

        def at(crossing: Crossing, used: int) -> float:
            if (crossing, used) not in known:
                roads = [self.roads[crossing, name] for name in crossing.options]
                parts = zip(chances(crossing.options), roads, strict=True)
                known[crossing, used] = sum(o * along(r, used) for o, r in parts)
            return known[crossing, used]

        return along(self.start, 0)


class _Guided:
    """Follows given choices, then takes the untried ones; notes every crossing it passes."""

    def __init__(
        self, points: Sequence[Point], choices: Sequence[str], tried: set[tuple[Crossing, str]]
    ):
        self.points, self.choices, self.tried = points, list(choices), tried
        self.passed: list[tuple[int, Crossing, str]] = []  # decision, crossing, choice
        self.decision = -1

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        self.world = world

    def reset(self, instruction: str, policy_seed: int) -> None:
        """The choices are all it has."""

    def act(self, observation: Observation) -> Action:
        self.decision += 1
        found = options(self.points, observation)
        if len(found) == 1:
            return next(iter(found.values())).next
        crossing = self._crossing(tuple(found))
        left = [name for name in found if (crossing, name) not in self.tried]
        known = len(self.passed) < len(self.choices)
        name = self.choices[len(self.passed)] if known else (left or list(found))[0]
        self.tried.add((crossing, name))
        self.passed.append((self.decision, crossing, name))
        return found[name].next

    def _crossing(self, names: tuple[str, ...]) -> Crossing:
        world = self.world
        state = [world.task.hidden_state(), sorted(set(world.violations)), world.success]
        return Crossing(names, json.dumps(state, sort_keys=True))


def explore(spec: EpisodeSpec, points: Sequence[Point], budget: int) -> Automaton:
    """Play one truth until every choice at every crossing was taken once."""
    tried: set[tuple[Crossing, str]] = set()
    paths: dict[Crossing, list[str]] = {}
    automaton = _run(spec, points, [], tried, paths, None, budget)
    while True:
        open_ends = [
            (crossing, name)
            for crossing in paths
            for name in crossing.options
            if (crossing, name) not in automaton.roads
        ]
        if not open_ends:
            return automaton
        crossing, name = min(open_ends, key=lambda end: len(paths[end[0]]))
        _run(spec, points, [*paths[crossing], name], tried, paths, automaton, budget)


def _run(
    spec: EpisodeSpec,
    points: Sequence[Point],
    choices: Sequence[str],
    tried: set[tuple[Crossing, str]],
    paths: dict[Crossing, list[str]],
    automaton: Automaton | None,
    budget: int,
) -> Automaton:
    guided = _Guided(points, choices, tried)
    result, records = play(spec, guided, budget=budget)
    success_at = next((r.decision + 1 for r in records if r.success), None)
    ends = [(decision, crossing) for decision, crossing, _ in guided.passed]
    begins = [0, *(decision for decision, _ in ends)]
    roads = []
    for i, begin in enumerate(begins):
        last = i == len(ends)
        length = (len(records) if last else ends[i][0]) - begin
        within = success_at is not None and begin < success_at <= begin + length
        roads.append(
            Road(
                decisions=length,
                success_after=success_at - begin if within and success_at is not None else None,
                exact=result.exact,
                end=None if last else ends[i][1],
            )
        )
    automaton = automaton or Automaton(roads[0])
    names = [name for _, _, name in guided.passed]
    for i, (_, crossing, name) in enumerate(guided.passed):
        if i + 1 < len(roads):
            automaton.roads.setdefault((crossing, name), roads[i + 1])
        paths.setdefault(crossing, names[:i])
    return automaton
