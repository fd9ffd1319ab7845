"""The walk over a truth's places gives its value and its slope."""

import numpy as np
import pytest

from hide_tasks.automaton import Automaton, Crossing, Road
from hide_tasks.mixing import _back, _numbers, _options, _softmax, _tree, best_mix, walk

BUDGET = 12


def some_automaton(seed):
    """Crossings in a ring, with roads of random lengths among them, that may end."""
    rng = np.random.default_rng(seed)
    ring = [Crossing(names, str(i)) for i, names in enumerate([("a", "b"), ("a", "c"), ("a", "b")])]
    roads = {}
    for crossing in ring:
        for name in crossing.options:
            end = None if rng.random() < 0.3 else ring[rng.integers(3)]
            success = int(rng.integers(1, 3)) if rng.random() < 0.4 else None
            roads[crossing, name] = Road(int(rng.integers(1, 4)), success, success == 1, end)
    return Automaton(Road(1, None, False, ring[0]), roads)


@pytest.mark.parametrize("verdict", ["success", "exact"])
@pytest.mark.parametrize("seed", range(8))
def test_the_walk_is_worth_what_the_automaton_says_and_its_slope_is_true(seed, verdict):
    automaton = some_automaton(seed)
    options = sorted(set(_options(automaton)))
    kinds = _numbers([kind for kind, _ in options])
    tree = _tree(automaton, options, verdict, BUDGET)

    def value(logits):
        odds = _softmax(logits, kinds)
        mix = {kind: {} for kind, _ in options}
        for (kind, name), share in zip(options, odds, strict=True):
            mix[kind][name] = float(share)
        return automaton.value(mix, verdict, BUDGET)

    logits = np.random.default_rng(seed).normal(0, 1, len(options))
    odds = _softmax(logits, kinds)
    found, slope = walk(*tree, odds)
    steps = 1e-6 * np.eye(len(options))
    numeric = [(value(logits + step) - value(logits - step)) / 2e-6 for step in steps]

    assert found == pytest.approx(value(logits), abs=1e-9)
    np.testing.assert_allclose(_back(slope, odds, kinds), numeric, atol=1e-6)
    assert best_mix([automaton], verdict, BUDGET)[1] >= found - 1e-9
