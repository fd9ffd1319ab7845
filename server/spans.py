"""Spans of hidden state, derived from an episode's start, decisions and changes."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from hide_tasks.contract import Belief, DecisionRecord, Start
from workers.protocol import HiddenChange

Lane = tuple[str, str]  # kind, name


@dataclass(frozen=True)
class Span:
    """A value that held from one moment to another."""

    kind: str  # hidden, stage, belief
    name: str
    number: int  # counts the spans of one lane
    value: Any
    decision_from: int
    decision_to: int
    time_from: float  # simulated seconds
    time_to: float


@dataclass(frozen=True)
class _Sight:
    """What is known at a moment."""

    time: float
    decision: int
    values: Mapping[Lane, Any]


def derive(
    start: Start, decisions: Iterable[DecisionRecord], changes: Iterable[HiddenChange]
) -> list[Span]:
    """The spans of an episode, lane by lane, in order of time."""
    decisions = list(decisions)
    times = [0.0, *(one.time for one in decisions)]
    sights = [_Sight(0.0, 0, _values(start.hidden, start.stage) | _believed(start.belief))]
    sights += [
        _Sight(chosen, one.decision, _believed(one.belief))
        for chosen, one in zip(times, decisions, strict=False)
    ]
    sights += [
        _Sight(change.time, change.decision, _values(change.hidden, change.stage))
        for change in changes
    ]
    sights += [
        _Sight(one.time, one.decision + 1, _values(one.hidden, one.stage)) for one in decisions
    ]
    sights.sort(key=lambda sight: sight.time)  # stable: a decision's row closes its moment
    lanes = dict.fromkeys(lane for sight in sights for lane in sight.values)
    return [span for lane in lanes for span in _spans(lane, sights)]


def _values(hidden: Mapping[str, Any], stage: str) -> dict[Lane, Any]:
    values: dict[Lane, Any] = {("hidden", name): value for name, value in hidden.items()}
    values["stage", "stage"] = stage
    return values


def _believed(belief: Belief | None) -> dict[Lane, Any]:
    """What a decision was chosen by; of the attention, what each view looks at most."""
    if belief is None:
        return {}
    said = belief.model_dump(mode="json", exclude_none=True, exclude={"attention"})
    for one in sorted(belief.attention, key=lambda one: one.weight):
        said[f"{one.view} looks at"] = one.slot
    return {("belief", name): value for name, value in said.items()}


def _spans(lane: Lane, sights: list[_Sight]) -> Iterator[Span]:
    seen = [sight for sight in sights if lane in sight.values]
    runs = [list(run) for _, run in groupby(seen, key=lambda sight: sight.values[lane])]
    last = sights[-1]
    for number, run in enumerate(runs):
        first, after = run[0], runs[number + 1][0] if number + 1 < len(runs) else last
        yield Span(
            kind=lane[0],
            name=lane[1],
            number=number,
            value=first.values[lane],
            decision_from=first.decision,
            decision_to=after.decision,
            time_from=first.time,
            time_to=after.time,
        )
