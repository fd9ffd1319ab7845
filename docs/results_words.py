"""How results are said in Markdown: numbers, intervals, tables."""

from collections.abc import Iterable, Sequence
from datetime import timedelta
from typing import Any

from server.published import SIMULATOR

ELSEWHERE = f"another simulator ({SIMULATOR}); not comparable figure by figure"
NONE = "–"
NAMES = {"seek": "SEEK", "twin": "memory-free twin"}
Figures = dict[str, Any]


def percent(value: float | None, digits: int = 1) -> str:
    """Without its sign: columns say that they are percent."""
    return NONE if value is None else f"{100 * value:.{digits}f}"


def interval(ends: Sequence[float] | None) -> str:
    """In percent."""
    return NONE if ends is None else f"[{percent(ends[0], 0)}, {percent(ends[1], 0)}]"


def rate(one: Figures | None) -> str:
    """A rate with the widest interval that it has: over seeds and episodes, or over episodes."""
    if not one:
        return NONE
    return f"{percent(one['value'])} {interval(one.get('over_seeds') or (one['low'], one['high']))}"


def difference(one: Figures | None) -> str:
    """In points, with its interval and p-value."""
    if not one:
        return NONE
    ends = one.get("over_seeds") or (one["low"], one["high"])
    return f"{100 * one['difference']:+.1f} {interval(ends)}"


def chance(p: float | None) -> str:
    """A p-value."""
    if p is None:
        return NONE
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def duration(seconds: float | None) -> str:
    """Hours, minutes and seconds."""
    return NONE if seconds is None else str(timedelta(seconds=round(seconds)))


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; all columns but the first are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)


def short(one: Figures | None) -> str:
    """A rate alone."""
    return percent(one["value"]) if one else NONE
