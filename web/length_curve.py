"""Success over the length of memory: measured with its interval, and as published, dashed."""

from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

from server.schemas.ablations import MeanRate
from web.charts import element

WIDTH, HEIGHT = 210.0, 120.0  # px of the plot
TOP, BELOW, LEFT, RIGHT = 16.0, 32.0, 30.0, 12.0
TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)


class Point(NamedTuple):
    """One length."""

    length: int
    rate: MeanRate | None  # none: not measured
    published: float | None


def curve(points: Sequence[Point], kind: str, label: str) -> Markup:
    """The curve of a category.

    Args:
        kind: class of its colour.
        label: what a reader that cannot see is told before the numbers.
    """
    return _Curve(max(point.length for point in points) or 1).drawn(points, kind, label)


class _Curve:
    """Places of lengths and rates."""

    def __init__(self, longest: int):
        self.longest = longest

    def x(self, length: int) -> float:
        return round(LEFT + 8 + (WIDTH - 16) * length / self.longest, 2)

    def y(self, value: float) -> float:
        return round(TOP + HEIGHT * (1 - value), 2)

    def drawn(self, points: Sequence[Point], kind: str, label: str) -> Markup:
        measured = [(one.length, one.rate.value) for one in points if one.rate]
        published = [(one.length, one.published) for one in points if one.published is not None]
        width, height = LEFT + WIDTH + RIGHT, TOP + HEIGHT + BELOW
        return element(
            "svg",
            *(mark for tick in TICKS for mark in self._tick(tick)),
            self._line(published, "published"),
            self._line(measured, "measured"),
            *(mark for one in points for mark in self._point(one)),
            element("text", "window, decisions", x=LEFT + WIDTH / 2, y=height - 3,
                    text_anchor="middle"),
            class_=f"length-curve {kind}",
            viewBox=f"0 0 {width:g} {height:g}",
            width=width,
            height=height,
            role="img",
            aria_label=f"{label}: {'; '.join(_told(one) for one in points)}",
        )  # fmt: skip

    def _tick(self, tick: float) -> list[Markup]:
        y = self.y(tick)
        text = element("text", f"{100 * tick:.0f}", x=LEFT - 6, y=y + 3.5, text_anchor="end")
        line = {"x1": LEFT, "x2": LEFT + WIDTH, "y1": y, "y2": y}
        return [element("line", class_="grid", **line), text]

    def _line(self, places: Sequence[tuple[int, float]], name: str) -> Markup:
        drawn = " ".join(f"{self.x(length):g},{self.y(value):g}" for length, value in places)
        return element("polyline", class_=name, points=drawn)

    def _point(self, one: Point) -> list[Markup]:
        x = self.x(one.length)
        marks = [element("text", str(one.length), class_="label", x=x, y=TOP + HEIGHT + 13,
                         text_anchor="middle")]  # fmt: skip
        if one.rate:
            low, high = self.y(one.rate.low), self.y(one.rate.high)
            marks += [
                element("line", class_="whisker", x1=x, x2=x, y1=low, y2=high),
                element("circle", class_="mark", cx=x, cy=self.y(one.rate.value), r=3.5),
            ]
        return [element("g", element("title", _told(one)), *marks)]


def _told(one: Point) -> str:
    said = f"length {one.length} not measured"
    if one.rate:
        low, high = (f"{100 * value:.0f}" for value in (one.rate.low, one.rate.high))
        value = f"{100 * one.rate.value:.0f} %"
        said = f"length {one.length} {value} ({low} to {high}, n {one.rate.episodes})"
    return said if one.published is None else f"{said}, paper {100 * one.published:.1f} %"
