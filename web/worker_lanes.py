"""How an evaluation went, drawn: a lane for what was played one after the other, over wall time.

Places along the time axis are percentages, so it fits any width without a script. The spans lead
to their episodes; for the keyboard and for screen readers the grid of episodes says the same.
"""

from collections.abc import Iterator
from datetime import datetime, timedelta

from markupsafe import Markup

from server.schemas.history import HistoryPublic, LaneSpan, Phase
from web import wording
from web.charts import element

LANE = 20  # pixels
BAR = 15
STRIP = 8  # of what the time was spent on
AXIS = 18
STEPS = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 21600, 43200, 86400)  # s
MARKS = 7  # at most
SOON = 5.0  # s that an axis has at least

ACTIVITIES = {
    "queued": "waited in the queue",
    "starting": "worker and policy started",
    "playing": "played",
    "lost": "lost tries",
    "waiting": "waited between",
    "stopped": "the server stopped",
    "incomplete": "waited to be resumed",
}


class LanesDrawing:
    """Lanes, what the time was spent on above them, and the time of day below."""

    def __init__(self, history: HistoryPublic):
        self.history = history
        self.start = history.start
        self.seconds = max((history.end - history.start).total_seconds(), SOON)

    @property
    def height(self) -> int:
        """Of the drawing, in pixels."""
        return STRIP + 6 + LANE * max(len(self.history.lanes), 1) + AXIS

    def svg(self) -> Markup:
        """The drawing, without the lanes' names."""
        parts = [*self._axis(), *self._strip(), *self._bars()]
        return element("svg", *parts, class_="work", height=self.height, aria_hidden="true")

    def _strip(self) -> Iterator[Markup]:
        for phase in self.history.phases:
            yield self._rect(phase.start, phase.end, 0, STRIP, phase.activity, said(phase))

    def _bars(self) -> Iterator[Markup]:
        for number, lane in enumerate(self.history.lanes):
            top = STRIP + 6 + LANE * number
            for span in lane.spans:
                bar = self._rect(
                    span.start, span.end or self.history.end, top, BAR, span.outcome, _told(span)
                )
                yield element("a", bar, href=f"/episodes/{span.episode}", tabindex=-1)

    def _rect(
        self, start: datetime, end: datetime, top: int, height: int, kind: str, title: str
    ) -> Markup:
        at, to = self._share(start), self._share(end)
        return element(
            "rect",
            element("title", title),
            class_=kind,
            x=f"{at:.3f}%",
            width=f"{max(to - at, 0.12):.3f}%",
            y=top,
            height=height,
        )

    def _axis(self) -> Iterator[Markup]:
        bottom = self.height - AXIS
        for moment in self._marks():
            at = f"{self._share(moment):.3f}%"
            yield element("line", class_="tick", x1=at, x2=at, y1=STRIP, y2=bottom + 4)
            text = f"{moment:%H:%M:%S}" if self.seconds < 600 else f"{moment:%H:%M}"
            yield element("text", text, class_="time", x=at, y=self.height - 3)

    def _marks(self) -> Iterator[datetime]:
        step = next((one for one in STEPS if self.seconds / one <= MARKS), STEPS[-1])
        first = self.start.timestamp() // step * step + step
        moment = datetime.fromtimestamp(first, self.start.tzinfo)
        while self._share(moment) < 97:
            if self._share(moment) > 2:
                yield moment
            moment += timedelta(seconds=step)

    def _share(self, moment: datetime) -> float:
        return 100 * (moment - self.start).total_seconds() / self.seconds


def said(phase: Phase) -> str:
    """A phase in words, e.g. 'waited in the queue, 2 min 03 s: workers played noop@1'."""
    seconds = (phase.end - phase.start).total_seconds()
    why = f": {phase.detail}" if phase.detail else ""
    return f"{ACTIVITIES[phase.activity]}, {wording.duration(seconds)}{why}"


def waits(history: HistoryPublic) -> list[Phase]:
    """The phases in which nobody played."""
    return [one for one in history.phases if one.activity != "playing"]


def summary(history: HistoryPublic) -> str:
    """The drawing in a sentence, for whoever does not see it."""
    spans = sum(len(lane.spans) for lane in history.lanes)
    lost = sum(span.outcome == "lost" for lane in history.lanes for span in lane.spans)
    spent = ", ".join(
        f"{ACTIVITIES[name]} {wording.duration(seconds)}"
        for name, seconds in history.seconds.items()
    )
    lanes = len(history.lanes)
    return f"{spans} tries at episodes, at most {lanes} at a time, {lost} lost." + (
        f" Time: {spent}." if spent else ""
    )


def _told(span: LaneSpan) -> str:
    took = f" in {wording.duration((span.end - span.start).total_seconds())}" if span.end else ""
    return f"{span.task} {span.index}: {span.outcome}{took}"
