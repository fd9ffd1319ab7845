"""What a policy remembered at each decision, as the page of an episode shows it."""

from collections.abc import Sequence
from typing import NamedTuple

from hide_tasks.contract import Attention, Belief
from server.schemas.episodes import BeliefCheck, BeliefsPublic, DecisionPublic

ANCHOR = "anchor"  # the slot of SEEK's persistent anchor
WINDOW = "window {}"  # the slots of its window, the latest entry first


class Entry(NamedTuple):
    """An earlier decision that is remembered."""

    decision: int
    slot: str
    weight: float | None  # of the attention, over all views


class Looks(NamedTuple):
    """How much each view looks at one memory."""

    slot: str
    weights: list[float | None]  # in the order of the views


class Memory(NamedTuple):
    """Everything that was stated at one decision."""

    decision: int
    belief: Belief
    check: BeliefCheck | None
    window: list[Entry]  # the oldest first
    anchor: Entry | None
    views: list[str]
    looks: list[Looks]


def memories(decisions: Sequence[DecisionPublic], beliefs: BeliefsPublic) -> list[Memory]:
    """What was stated at each decision at which something was."""
    checks = {one.decision: one for one in beliefs.decisions}
    return [
        _memory(one.decision, one.belief, checks.get(one.decision))
        for one in decisions
        if one.belief is not None
    ]


def _memory(decision: int, belief: Belief, check: BeliefCheck | None) -> Memory:
    views = list(dict.fromkeys(one.view for one in belief.attention))
    looks = _looks(belief.attention, views)
    weights = {one.slot: _mean(one.weights) for one in looks}
    latest_first = [WINDOW.format(age + 1) for age in range(len(belief.window or ()))]
    window = [
        Entry(seen, slot, weights.get(slot))
        for seen, slot in zip(belief.window or (), reversed(latest_first), strict=True)
    ]
    anchor = None
    if belief.anchor_index is not None:
        anchor = Entry(belief.anchor_index, ANCHOR, weights.get(ANCHOR))
    return Memory(decision, belief, check, window, anchor, views, looks)


def _looks(attention: Sequence[Attention], views: Sequence[str]) -> list[Looks]:
    weight = {(one.slot, one.view): one.weight for one in attention}
    slots = dict.fromkeys(one.slot for one in attention)
    return [Looks(slot, [weight.get((slot, view)) for view in views]) for slot in slots]


def _mean(weights: Sequence[float | None]) -> float:
    known = [one or 0.0 for one in weights]
    return sum(known) / len(known)
