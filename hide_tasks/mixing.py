"""The best odds for a policy without memory, by gradient.

From the start of a truth its roads lead to places: a crossing, and how many decisions are used by
then. One walk back over them gives what a mix is worth, one forth and back its gradient.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hide_tasks.amnesiac import look
from hide_tasks.automaton import Automaton, Crossing, Road, Verdict

STARTS = 8  # of the search
SUREST = 14.0  # logits either way: a choice may be as sure as one in a million
OVER = -1  # where an edge leads when the verdict is known

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Option = tuple[str, str]  # what is open, and what is picked of it
Place = tuple[Crossing, int]  # and how many decisions are used by then
Mixed = dict[str, dict[str, float]]


class Tree(NamedTuple):
    """One truth as edges; those of a place come together, and places before those they lead to."""

    place: Ints  # (e,) whence
    option: Ints  # (e,) by which option
    goal: Ints  # (e,) to which place, or OVER
    worth: Floats  # (e,) 1 if the verdict is reached when it is over
    places: int


def best_mix(automata: Sequence[Automaton], verdict: Verdict, budget: int) -> tuple[Mixed, float]:
    """The odds that maximise a verdict's mean probability over equally likely truths."""
    options = sorted({option for one in automata for option in _options(one)})
    if not options:
        return {}, float(np.mean([one.value({}, verdict, budget) for one in automata]))
    sure = [one.start.worth(0, verdict, budget) for one in automata]
    trees = [
        _tree(one, options, verdict, budget)
        for one, worth in zip(automata, sure, strict=True)
        if worth is None
    ]
    kinds = _numbers([kind for kind, _ in options])
    certain = sum(worth for worth in sure if worth is not None)

    def loss(logits: Floats) -> tuple[float, Floats]:
        odds = _softmax(logits, kinds)
        value, slope = certain, np.zeros(len(odds))
        for tree in trees:
            one, its = walk(*tree, odds)
            value, slope = value + one, slope + its
        return -value / len(automata), -_back(slope, odds, kinds) / len(automata)

    best = min((_descend(loss, start) for start in _starts(len(options))), key=lambda r: r.fun)
    odds = _softmax(best.x, kinds).round(6).tolist()
    mix: Mixed = {kind: {} for kind, _ in options}
    for (kind, name), value in zip(options, odds, strict=True):
        mix[kind][name] = value
    return mix, -float(best.fun)


def _options(automaton: Automaton) -> list[Option]:
    return [(look(crossing.options), name) for crossing, name in automaton.roads]


def _numbers(names: Sequence[str]) -> Ints:
    found = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return np.array([found[name] for name in names])


def _starts(count: int) -> list[Floats]:
    rng = np.random.default_rng(0)
    return [np.zeros(count), *rng.normal(0, 1.5, (STARTS - 1, count))]


def _descend(loss: Any, start: Floats) -> Any:
    bounds = [(-SUREST, SUREST)] * len(start)
    return minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)


def _softmax(logits: Floats, kinds: Ints) -> Floats:
    weights = np.exp(logits - logits.max())
    return np.asarray(weights / np.bincount(kinds, weights)[kinds])


def _back(slope: Floats, odds: Floats, kinds: Ints) -> Floats:
    """The gradient by the logits from that by the odds."""
    return np.asarray(odds * (slope - np.bincount(kinds, odds * slope)[kinds]))


def _tree(automaton: Automaton, options: Sequence[Option], verdict: Verdict, budget: int) -> Tree:
    number = {option: i for i, option in enumerate(options)}
    places = {place: i for i, place in enumerate(_reached(automaton, verdict, budget))}
    edges = []
    for (crossing, used), place in places.items():
        for name in crossing.options:
            road = automaton.roads[crossing, name]
            worth = road.worth(used, verdict, budget)
            goal = OVER if worth is not None else places[_end(road, used)]
            edges.append((place, number[look(crossing.options), name], goal, worth or 0.0))
    at, option, goals, worths = zip(*edges, strict=True)
    return Tree(np.array(at), np.array(option), np.array(goals), np.array(worths), len(places))


def _reached(automaton: Automaton, verdict: Verdict, budget: int) -> list[Place]:
    """The places that can come up; no road is without a decision, so by these they are in order."""
    found = {_end(automaton.start, 0): None}  # in the order in which they are found
    ahead = list(found)
    while ahead:
        crossing, used = ahead.pop()
        roads = [automaton.roads[crossing, name] for name in crossing.options]
        open_ = [road for road in roads if road.worth(used, verdict, budget) is None]
        new = [place for road in open_ if (place := _end(road, used)) not in found]
        found |= dict.fromkeys(new)
        ahead += new
    return sorted(found, key=lambda place: place[1])


def _end(road: Road, used: int) -> Place:
    assert road.end is not None, "a road that is worth nothing yet leads on"
    return road.end, used + road.decisions


def _walk(
    place: Ints, option: Ints, goal: Ints, worth: Floats, places: int, odds: Floats
) -> tuple[float, Floats]:
    """The probability of the verdict by these odds, and its slope by each of them."""
    values = np.zeros(places)
    for e in range(len(place) - 1, -1, -1):
        got = worth[e] if goal[e] == OVER else values[goal[e]]
        values[place[e]] += odds[option[e]] * got
    slope, reach = np.zeros(len(odds)), np.zeros(places)
    reach[0] = 1.0
    for e in range(len(place)):
        got = worth[e] if goal[e] == OVER else values[goal[e]]
        slope[option[e]] += reach[place[e]] * got
        if goal[e] != OVER:
            reach[goal[e]] += reach[place[e]] * odds[option[e]]
    return values[0], slope


Walk = Callable[[Ints, Ints, Ints, Floats, int, Floats], tuple[float, Floats]]
walk = cast(Walk, numba.njit(_walk))
