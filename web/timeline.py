"""The hidden-state timeline of an episode: lanes of values over simulated time, as SVG.

Places along the time axis are percentages, so it fits any width without a script; every span is
an SVG of its own, which cuts off a text that is too long for it.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from server.schemas.episodes import BeliefsPublic, DecisionPublic, EpisodeDetail, SpanPublic
from web import belief_track, lanes, wording
from web.charts import element
from web.lanes import Lane, Span

LANE = 22  # pixels
BAR = 18
AXIS = 18
SHADES = 10  # as many as the style sheet has
SAID = ("hidden", "stage", "truth", "count")  # lanes that a screen reader is told of
FIXED = {"yes": "yes", "no": "no", "–": "nothing"}
NAMED = {"truth": "true ", "count": "believed "}  # before a lane's name
STEPS = (0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600)  # seconds between two marks of the axis
MARKS = 8  # at most


class Mark(NamedTuple):
    """Something at one moment."""

    kind: str  # event, violation
    text: str
    time: float


class Timeline:
    """What happened in an episode, lane by lane."""

    def __init__(
        self,
        episode: EpisodeDetail,
        decisions: Sequence[DecisionPublic],
        spans: Sequence[SpanPublic],
        beliefs: BeliefsPublic | None = None,
    ):
        ends = [decision.time for decision in decisions]
        self.end = max([*ends, *(span.time_to for span in spans), 0.001])
        self.scale = self.end  # seconds over the whole width: beside another run the longer one's
        self.moments = [0.0, *ends]  # decision k is chosen at moments[k]
        self.lanes = list(belief_track.lanes(beliefs, self.moments)) if beliefs else []
        self.lanes += [*lanes.of_spans(spans), *lanes.of_checks(episode, decisions, self.end)]
        self.marks = list(_marks(decisions))
        self.parted: float | None = None  # where another run went another way

    @property
    def height(self) -> int:
        """Of the drawing, in pixels."""
        return LANE * (len(self.lanes) + 1) + AXIS

    def svg(self) -> Markup:
        """The drawing, without the names of the lanes."""
        parts = [*self._ticks(), *self._bars(), *self._marked(), *self._axis(), *self._parting()]
        parts.append(self._cursor())
        return element("svg", *parts, class_="lanes", height=self.height, aria_hidden="true")

    def _ticks(self) -> Iterator[Markup]:
        bottom = LANE * (len(self.lanes) + 1)
        for moment in self.moments:
            at = self._share(moment)
            yield element("line", class_="decision", x1=at, x2=at, y1=0, y2=bottom)

    def _bars(self) -> Iterator[Markup]:
        for row, lane in enumerate(self.lanes):
            shades = _shades(lane)
            for span in lane.spans:
                yield self._bar(LANE * row + 2, lane, span, shades[span.value])

    def _bar(self, top: int, lane: Lane, span: Span, shade: str) -> Markup:
        text = f"{NAMED.get(lane.kind, '')}{wording.words(lane.name)}: {span.value}"
        when = f"{wording.seconds(span.begin)} to {wording.seconds(span.end)}"
        return element(
            "svg",
            element("title", f"{text}, {when}"),
            element("rect", width="100%", height=BAR, rx=2),
            *_hatched(span),
            element("text", span.value, x=5, y=13),
            class_=f"span {lane.kind} {span.state or shade}",
            x=self._share(span.begin),
            y=top,
            width=self._share(max(span.end - span.begin, self.scale / 500)),
            height=BAR,
            data_begin=span.begin,
            data_end=span.end,
            data_said=text if lane.kind in SAID else None,
        )

    def _marked(self) -> Iterator[Markup]:
        middle = LANE * len(self.lanes) + LANE // 2
        for mark in self.marks:
            title = element("title", f"{mark.text}, at {wording.seconds(mark.time)}")
            shape = "M-4 5 0-4 4 5Z" if mark.kind == "event" else "M-5-5 5 5M5-5-5 5"
            drawn = element("path", d=shape)
            yield element(
                "svg", title, drawn, class_=f"mark {mark.kind}", x=self._share(mark.time), y=middle
            )

    def _parting(self) -> Iterator[Markup]:
        if self.parted is not None:
            at, bottom = self._share(self.parted), self.height - AXIS
            yield element("line", class_="parted", x1=at, x2=at, y1=0, y2=bottom)

    def _axis(self) -> Iterator[Markup]:
        step = next((step for step in STEPS if self.scale / step <= MARKS), STEPS[-1])
        bottom = LANE * (len(self.lanes) + 1)
        for number in range(int(self.scale / step) + 1):
            time = number * step
            last = time > 0.96 * self.scale
            at, anchor = self._share(time), "end" if last else "middle" if number else "start"
            label = f"{time:g}{wording.THIN}s"
            yield element("text", label, class_="axis", x=at, y=bottom + 14, text_anchor=anchor)

    def _cursor(self) -> Markup:
        return element("line", class_="cursor", x1="0%", x2="0%", y1=0, y2=self.height - AXIS)

    def _share(self, time: float) -> str:
        return f"{100 * time / self.scale:.3f}%"


def _hatched(span: Span) -> Iterator[Markup]:
    """Not by colour alone: the pattern stands in the page, once."""
    if span.state == "wrong":
        yield element("rect", width="100%", height=BAR, rx=2, fill="url(#hatch)", class_="hatch")


def _marks(decisions: Sequence[DecisionPublic]) -> Iterator[Mark]:
    seen: set[str] = set()
    for decision in decisions:
        for event in decision.events:
            yield Mark("event", f"{wording.words(event.name)} {event.total}", event.time)
        for violation in dict.fromkeys(decision.violations):
            if violation not in seen:
                seen.add(violation)
                yield Mark("violation", f"violation: {wording.words(violation)}", decision.time)


def _shades(lane: Lane) -> dict[str, str]:
    """A class of the style sheet for each value, the same ones however many follow."""
    values: dict[str, Any] = dict.fromkeys(span.value for span in lane.spans)
    return {
        value: FIXED.get(value, f"shade-{number % SHADES}") for number, value in enumerate(values)
    }
