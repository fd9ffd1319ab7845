"""A forest plot: differences with their intervals on one axis, a line of a table each."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil

from markupsafe import Markup

from server.schemas.comparisons import Paired
from web.charts import element

STEP = 0.2  # of the axis
ROOM = 0.04  # of the width, left and right of the outermost ticks


@dataclass(frozen=True)
class Axis:
    """Differences of rates from `-most` to `most`, over the whole width."""

    most: float

    @classmethod
    def over(cls, found: Iterable[Paired]) -> "Axis":
        """One that holds all intervals."""
        widest = max((max(-one.low, one.high) for one in found), default=STEP)
        return cls(min(1.0, max(1, ceil(widest / STEP - 1e-9)) * STEP))

    @property
    def ticks(self) -> list[float]:
        """At the ends, half way and at none."""
        return [self.most * share for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]

    def at(self, value: float) -> str:
        """Where a difference stands, in percent of the width."""
        share = (value / self.most + 1) / 2
        return f"{100 * (ROOM + (1 - 2 * ROOM) * share):.2f}%"

    def labels(self) -> Markup:
        """The head of the column."""
        marks = [
            element("text", f"{100 * tick:+.0f}".replace("-", "−").replace("+0", "0"),
                    x=self.at(tick), y=12, text_anchor="middle")
            for tick in self.ticks
        ]  # fmt: skip
        return element("svg", *marks, class_="forest-axis", height=16, aria_hidden="true")

    def line(self, one: Paired, kind: str, *, summary: bool = False) -> Markup:
        """One difference; the numbers stand beside it.

        Args:
            kind: class of its colour.
            summary: of several tasks.
        """
        grid = [
            element("line", class_="none" if tick == 0 else "grid",
                    x1=self.at(tick), x2=self.at(tick), y1="0", y2="100%")
            for tick in self.ticks
        ]  # fmt: skip
        shape = "-7,0 0,-6 7,0 0,6" if summary else "-4,-4 4,-4 4,4 -4,4"
        mark = element(
            "svg",
            element("polygon", class_="mark", points=shape),
            x=self.at(one.difference),
            y="50%",
            overflow="visible",
        )
        whisker = element(
            "line", class_="whisker", x1=self.at(one.low), x2=self.at(one.high), y1="50%", y2="50%"
        )
        name = f"forest {kind}" + (" summary" if summary else "")
        return element("svg", *grid, whisker, mark, class_=name, aria_hidden="true")
