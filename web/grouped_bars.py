"""Rates as upright bars with their intervals, side by side."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from markupsafe import Markup

from web.charts import element

HEIGHT = 120.0  # px of 100 %
TOP, BELOW, LEFT = 16.0, 18.0, 30.0  # px
WIDTH, AROUND = 22.0, 12.0  # px of a bar, and of what is around it
LETTER = 8.0  # px of a label's, at most
TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)


class Measured(Protocol):
    """A rate, or a mean of rates."""

    @property
    def value(self) -> float | None: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...
    @property
    def episodes(self) -> int: ...


class Bar(NamedTuple):
    """One rate."""

    label: str  # short: it stands below the bar
    name: str
    rate: Measured | None  # none: not measured
    published: float | None = None  # the paper's figure, drawn as a dashed line


def grouped(bars: Sequence[Bar], kind: str, label: str) -> Markup:
    """The bars of one group.

    Args:
        kind: class of their colour.
        label: what a reader that cannot see is told before the numbers.
    """
    pitch = max(WIDTH + AROUND, LETTER * max((len(bar.label) for bar in bars), default=0) + 6)
    width = LEFT + pitch * len(bars) + 4
    marks = [mark for tick in TICKS for mark in _tick(tick, width)]
    for place, bar in enumerate(bars):
        marks += _bar(bar, LEFT + pitch * place + (pitch - WIDTH) / 2)
    return element(
        "svg",
        *marks,
        class_=f"grouped-bars {kind}",
        viewBox=f"0 0 {width:g} {TOP + HEIGHT + BELOW:g}",
        width=width,
        height=TOP + HEIGHT + BELOW,
        role="img",
        aria_label=f"{label}: {', '.join(_told(bar) for bar in bars)}",
    )


def _tick(tick: float, width: float) -> list[Markup]:
    y = _at(tick)
    text = element("text", f"{100 * tick:.0f}", x=LEFT - 6, y=y + 3.5, text_anchor="end")
    return [element("line", class_="grid", x1=LEFT, x2=width, y1=y, y2=y), text]


def _bar(bar: Bar, x: float) -> list[Markup]:
    middle = x + WIDTH / 2
    below = TOP + HEIGHT + 13
    marks = [element("text", bar.label, class_="label", x=middle, y=below, text_anchor="middle")]
    if bar.rate is not None and bar.rate.value is not None:
        marks += _measured(bar.rate, bar.rate.value, x)
    if bar.published is not None:
        y = _at(bar.published)
        line = element("line", class_="published", x1=x - 4, x2=x + WIDTH + 4, y1=y, y2=y)
        marks.insert(2, line)  # above the bar, below its number
    return [element("g", element("title", _told(bar)), *marks)]


def _measured(rate: Measured, value: float, x: float) -> list[Markup]:
    middle, y = x + WIDTH / 2, _at(value)
    whisker = {"x1": middle, "x2": middle, "y1": _at(rate.low), "y2": _at(rate.high)}
    number = {"x": middle, "y": _at(rate.high) - 4, "text_anchor": "middle"}
    return [
        element("rect", class_="bar", x=x, y=y, width=WIDTH, height=_at(0.0) - y),
        element("line", class_="whisker", **whisker),
        element("text", f"{100 * value:.0f}", class_="value", **number),
    ]


def _told(bar: Bar) -> str:
    if bar.rate is None or bar.rate.value is None:
        said = f"{bar.name} not measured"
    else:
        low, high = (f"{100 * value:.0f}" for value in (bar.rate.low, bar.rate.high))
        said = f"{bar.name} {100 * bar.rate.value:.0f} % ({low} to {high}, n {bar.rate.episodes})"
    return said if bar.published is None else f"{said}, paper {100 * bar.published:.1f} %"


def _at(value: float) -> float:
    return round(TOP + HEIGHT * (1 - value), 2)
