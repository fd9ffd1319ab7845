"""The lanes of an episode: values over simulated time."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from server.schemas.episodes import DecisionPublic, EpisodeDetail, SpanPublic
from web import wording

# What is counted has a track of its own, under the truth; the window is seen in pictures.
ELSEWHERE = {("belief", "stage_count"), ("belief", "window")}


class Span(NamedTuple):
    """A value from one time to another."""

    value: str
    begin: float  # simulated seconds
    end: float
    state: str = ""  # of what is believed: right, wrong, unknown


class Lane(NamedTuple):
    """One named thing over time."""

    kind: str
    name: str
    spans: list[Span]


def of_spans(spans: Iterable[SpanPublic]) -> list[Lane]:
    """What is hidden, believed and called for; lane by lane."""
    found: dict[tuple[str, str], list[Span]] = {}
    shown = [span for span in spans if (span.kind, span.name) not in ELSEWHERE]
    for kind in ("hidden", "belief", "stage"):
        for span in (span for span in shown if span.kind == kind):
            one = Span(_said(span), span.time_from, span.time_to)
            found.setdefault((kind, span.name), []).append(one)
    return [Lane(kind, name, lane) for (kind, name), lane in found.items()]


def _said(span: SpanPublic) -> str:
    """Its value; a policy's own measurement changes with every decision, and is rounded."""
    measured = span.kind == "belief" and isinstance(span.value, float)
    return f"{span.value:.2f}" if measured else wording.value(span.value)


def of_checks(
    episode: EpisodeDetail, decisions: Sequence[DecisionPublic], end: float
) -> Iterator[Lane]:
    """Which checks held when."""
    if not episode.start:
        return
    known: list[tuple[float, dict[str, bool]]] = [(0.0, episode.start.checks)]
    known += [(decision.time, decision.checks) for decision in decisions]
    for name in episode.start.checks:
        points = [(time, wording.value(checks[name])) for time, checks in known if name in checks]
        yield Lane("check", name, list(_joined([*points, (end, "")])))


def _joined(points: Sequence[tuple[float, str]]) -> Iterator[Span]:
    """Spans of values, given at times; what follows one of the same value belongs to it."""
    begin = points[0][0]
    for (_, value), (time, following) in pairwise(points):
        if following != value:
            yield Span(value, begin, time)
            begin = time
