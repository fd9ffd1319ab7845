"""Charts of the leaderboard as SVG: categories as bars, a radar, tasks as dots.

A policy has a number in all of them, so that no colour tells what nothing else does. Lengths
across are shares of the width, so that text keeps its size on any screen.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil, cos, pi, sin
from typing import NamedTuple

from markupsafe import Markup

from hide_tasks.contract import Category
from hide_tasks.suite import SPLITS as SPLITS
from server.schemas.common import RatePublic
from server.schemas.leaderboard import Leaderboard, LeaderboardRow
from web import wording
from web.charts import element

GROUPS = ("overall", *(str(one) for one in Category))
ROW, BAR = 34, 11  # px of a policy among the bars, and of its bar
LANE, DOT = 15, 6.5  # px of a policy among a task's dots, and a dot's radius
HEAD = 20  # px above the dots of a task
AXIS = 18  # px below, for the scale
LONGEST = 30  # characters of a name
SIZE, CENTRE, RADIUS = (480, 372), (240.0, 238.0), 200.0  # of the radar
RINGS = 4
STEP = 0.1  # to which a radar's scale is rounded up


class Charted(NamedTuple):
    """A policy in a chart."""

    number: int
    name: str
    row: LeaderboardRow


def numbered(rows: Iterable[LeaderboardRow]) -> list[Charted]:
    """The rows with their numbers and names."""
    return [
        Charted(number, f"{row.policy}@{row.version}", row)
        for number, row in enumerate(rows, start=1)
    ]


def rate(one: Charted, column: str, board: Leaderboard) -> RatePublic:
    """The rate of a policy overall, in a category, or in a task."""
    found = {"overall": one.row.overall, **one.row.categories, **one.row.tasks}[column]
    by_verdict: RatePublic = getattr(found, board.verdict)
    return by_verdict


def said(found: RatePublic) -> str:
    """A rate with its interval and number, in words."""
    bounds = f"{wording.number(found.low)} to {wording.number(found.high)}"
    return f"{wording.number(found.value)} % ({bounds}, n {found.episodes})"


# --- categories as bars ---


def bars(board: Leaderboard, charted: Sequence[Charted], group: str) -> Markup:
    """The rates of a category, a bar each with its interval, and the best without memory."""
    height = ROW * len(charted)
    ceiling = board.ceilings.get(group)
    marks = [*_grid(height), *_scale(height)]
    for number, one in enumerate(charted):
        marks += _bar(one, rate(one, group, board), ROW * number)
        if ceiling is not None:
            marks.append(_tick(ceiling, ROW * number + 18, BAR))
    told = [f"{one.name}: {said(rate(one, group, board))}" for one in charted]
    title = f"{board.verdict.capitalize()} in percent, {_long(group)}"
    return _chart(f"bars-{group}", title, told, height + AXIS, marks, group, ceiling)


def _bar(one: Charted, found: RatePublic, top: float) -> Iterator[Markup]:
    middle = top + 18 + BAR / 2
    value = found.value or 0.0
    kind = "bar reference" if one.row.reference else "bar"
    yield _text(f"{one.number}  {shortened(one.name)}", x=0, y=top + 13, class_="name")
    yield _text(wording.number(found.value), x="100%", y=top + 13, class_="value")
    yield element("rect", class_=kind, x=0, y=top + 18, width=_share(value), height=BAR)
    yield _interval(found, middle)


# --- tasks as dots ---


def dots(board: Leaderboard, charted: Sequence[Charted], kind: Category) -> Markup:
    """The rates of a category's tasks: a numbered dot each with its interval."""
    tasks = [column.task for column in board.columns if column.category is kind]
    block = HEAD + LANE * len(charted) + 12
    marks: list[Markup] = []
    for number, task in enumerate(tasks):
        marks += _task(board, charted, task, block * number)
    told = [
        f"{task}, {one.name}: {said(rate(one, task, board))}" for task in tasks for one in charted
    ]
    height = block * len(tasks) - 12
    title = f"{board.verdict.capitalize()} in percent by task, {_long(str(kind))}"
    marks += _scale(height)
    return _chart(f"dots-{kind}", title, told, height + AXIS, marks, str(kind), None)


def _task(
    board: Leaderboard, charted: Sequence[Charted], task: str, top: float
) -> Iterator[Markup]:
    ceiling, height = board.ceilings.get(task), LANE * len(charted)
    yield _text(task, x=0, y=top + 13, class_="name strong")
    if ceiling is not None:
        label = f"without memory {wording.number(ceiling)}"
        yield _text(label, x="100%", y=top + 13, class_="value muted")
    yield from _grid(height, top + HEAD, ground=True)
    if ceiling is not None:
        yield _tick(ceiling, top + HEAD, height)
    for number, one in enumerate(charted):
        found, middle = rate(one, task, board), top + HEAD + LANE * (number + 0.5)
        at, kind = _share(found.value or 0.0), " reference" if one.row.reference else ""
        title = element("title", f"{one.name} on {task}: {said(found)}")
        yield element(
            "g",
            title,
            _interval(found, middle),
            element("circle", class_=f"dot{kind}", cx=at, cy=middle, r=DOT),
            _text(str(one.number), x=at, y=middle + 3, class_=f"number{kind}"),
        )


# --- the radar ---


def scales(board: Leaderboard, charted: Sequence[Charted]) -> dict[str, float]:
    """Where each axis of the radar ends: above all that is shown, as the paper's figure does it."""
    found = {}
    for kind in Category:
        values = [rate(one, str(kind), board).value or 0.0 for one in charted]
        highest = max([*values, board.ceilings.get(str(kind)) or 0.0, STEP])
        found[str(kind)] = min(1.0, ceil(round(highest / STEP, 6)) * STEP)
    return found


def radar(board: Leaderboard, charted: Sequence[Charted]) -> Markup:
    """The rates of the categories, an axis each with a scale of its own."""
    ends = scales(board, charted)
    marks = [_ring(part / RINGS) for part in range(1, RINGS + 1)]
    marks += [mark for axis, end in enumerate(ends.items()) for mark in _axis(axis, *end)]
    ceilings = [board.ceilings.get(kind) for kind in ends]
    if None not in ceilings:
        shares = [(value or 0) / end for value, end in zip(ceilings, ends.values(), strict=True)]
        marks.append(element("polygon", class_="ceilings", points=_points(shares)))
    for one in charted:
        values = [rate(one, kind, board).value or 0.0 for kind in ends]
        shares = [value / end for value, end in zip(values, ends.values(), strict=True)]
        marks += _polygon(one, shares)
    told = [
        f"{one.name}: " + ", ".join(f"{kind} {said(rate(one, kind, board))}" for kind in ends)
        for one in charted
    ]
    title = f"{board.verdict.capitalize()} by category; each axis has a scale of its own"
    size = {"width": SIZE[0], "height": SIZE[1], "viewBox": f"0 0 {SIZE[0]} {SIZE[1]}"}
    return _labelled("radar", title, told, marks, class_="chart radar", **size)


def _polygon(one: Charted, shares: Sequence[float]) -> Iterator[Markup]:
    series = f"series-{one.number}"
    title = element("title", one.name)
    yield element("polygon", title, class_=f"policy {series}", points=_points(shares))
    for axis, share in enumerate(shares):
        x, y = _place(axis, share)
        yield element("circle", class_=f"corner {series}", cx=x, cy=y, r=3.5)


def _ring(share: float) -> Markup:
    return element("polygon", class_="ring", points=_points([share] * len(Category)))


def _axis(axis: int, kind: str, end: float) -> Iterator[Markup]:
    x, y = _place(axis, 1.0)
    at, height = (x, y - 14) if axis == 0 else (x, y + 20)
    yield element("line", class_="axis", x1=CENTRE[0], y1=CENTRE[1], x2=x, y2=y)
    label = f"{kind}, to {wording.number(end)} %"
    yield _text(label, class_=f"end {kind}", x=at, y=height, text_anchor="middle")


def _points(shares: Sequence[float]) -> str:
    places = [_place(axis, share) for axis, share in enumerate(shares)]
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _place(axis: int, share: float) -> tuple[float, float]:
    """A point on an axis; the first one points upwards, the others follow clockwise."""
    angle = 2 * pi * axis / len(Category) - pi / 2
    x, y = CENTRE[0] + share * RADIUS * cos(angle), CENTRE[1] + share * RADIUS * sin(angle)
    return round(x, 1), round(y, 1)


# --- parts of all of them ---


def shortened(name: str) -> str:
    """A name that fits above its bar."""
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 9]}…{name[-8:]}"


def _long(group: str) -> str:
    return "all tasks" if group == "overall" else wording.CATEGORIES[Category(group)]


def _grid(height: float, top: float = 0, *, ground: bool = False) -> Iterator[Markup]:
    if ground:
        yield element("rect", class_="ground", x=0, y=top, width="100%", height=height)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        at = _share(share)
        yield element("line", class_="grid", x1=at, x2=at, y1=top, y2=top + height)


def _scale(top: float) -> Iterator[Markup]:
    for share, anchor in ((0.0, "start"), (0.5, "middle"), (1.0, "end")):
        label = f"{100 * share:.0f}"
        yield _text(label, x=_share(share), y=top + 13, class_="scale", text_anchor=anchor)


def _tick(ceiling: float, top: float, height: float) -> Markup:
    at = _share(min(max(ceiling, 0.003), 0.997))
    return element("line", class_="ceiling", x1=at, x2=at, y1=top - 2, y2=top + height + 2)


def _interval(found: RatePublic, y: float) -> Markup:
    return element(
        "line", class_="whisker", x1=_share(found.low), x2=_share(found.high), y1=y, y2=y
    )


def _chart(
    name: str,
    title: str,
    told: Sequence[str],
    height: float,
    marks: Iterable[Markup],
    group: str,
    ceiling: float | None,
) -> Markup:
    known = [] if ceiling is None else [f"Best without memory: {wording.number(ceiling)} %"]
    kind = f"chart {group}"
    return _labelled(name, title, [*told, *known], marks, class_=kind, width="100%", height=height)


def _labelled(
    name: str, title: str, told: Sequence[str], marks: Iterable[Markup], **attributes: object
) -> Markup:
    """A picture with its title and what it tells."""
    described = element("desc", ". ".join(told), id=f"{name}-desc")
    named = {"aria_labelledby": f"{name}-title", "aria_describedby": f"{name}-desc"}
    head = element("title", title, id=f"{name}-title")
    return element("svg", head, described, *marks, role="img", **named, **attributes)


def _text(text: str, **attributes: object) -> Markup:
    return element("text", text, **attributes)


def _share(value: float) -> str:
    return f"{100 * value:.2f}".rstrip("0").rstrip(".") + "%"
