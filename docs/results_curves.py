"""How trainings went: their journals, thinned to be kept, and a plot of them.

A line of a kept journal is the mean over some steps, or a validation with its overall figures.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple

from markupsafe import Markup

from seek_model.progress import LOSSES, PHASES
from web.charts import element

POINTS = 100  # of a phase
SHOWN = "translation"  # the loss that is drawn: of the place, coarse and fine
NEAR = "position_near"  # the share of keyframes under 2 cm
Row = dict[str, Any]

# --- kept ---


def kept(folder: Path) -> list[Row]:
    """A training's journal, thinned; empty if there is none."""
    path = folder / LOSSES
    if not path.exists():
        return []
    found: list[Row] = []
    rows = (json.loads(line) for line in path.read_text().splitlines())
    for _, of_phase in groupby(rows, key=lambda row: row["phase"]):
        of_kind: dict[str, list[Row]] = {"step": [], "validation": []}
        for row in of_phase:
            of_kind[row["kind"]].append(row)
        found += thinned(of_kind["step"])
        found += [_validation(row) for row in of_kind["validation"]]
    return found


def thinned(steps: Sequence[Row]) -> list[Row]:
    """About POINTS means over as many steps each."""
    size = max(round(len(steps) / POINTS), 1)
    return [_mean(steps[first : first + size]) for first in range(0, len(steps), size)]


def _mean(rows: Sequence[Row]) -> Row:
    names = [name for name in rows[0]["losses"] if all(name in row["losses"] for row in rows)]
    return {
        "kind": "step",
        "phase": rows[0]["phase"],
        "step": rows[-1]["step"],
        "losses": {name: _short(fmean(row["losses"][name] for row in rows)) for name in names},
        "samples_per_second": _short(median(row["samples_per_second"] for row in rows)),
    }


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _validation(row: Row) -> Row:
    return {name: row[name] for name in ("kind", "phase", "step", "overall")}


def samples_per_second(rows: Sequence[Row]) -> float | None:
    """The median pace of a training's last phase."""
    steps = [row for row in rows if row["kind"] == "step"]
    paces = [row["samples_per_second"] for row in steps if row["phase"] == steps[-1]["phase"]]
    return _short(median(paces)) if paces else None


def text(rows: Sequence[Row]) -> str:
    """As it is kept in a file."""
    return "".join(json.dumps(row) + "\n" for row in rows)


def read(folder: Path) -> dict[str, list[Row]]:
    """What is kept of every run, by name."""
    return {
        path.stem: [json.loads(line) for line in path.read_text().splitlines()]
        for path in sorted(folder.glob("*.jsonl"))
    }


# --- drawn ---

WIDTH, HEIGHT = 330.0, 170.0  # px of a panel's inside
LEFT, TOP, RIGHT, BELOW = 46.0, 34.0, 14.0, 30.0
COLORS = {"seek": "#0b6e4f", "twin": "#b3541e", "first": "#33415c", "": "#9aa5b1"}
LEGEND = {
    "seek": "SEEK",
    "twin": "memory-free twin",
    "": "ablations, clock",
    "first": "the shared first phase",
}
Line = list[tuple[float, float]]


class Panel(NamedTuple):
    """One plot."""

    title: str
    lines: Mapping[str, Line]  # by run
    share: bool  # 0 to 1, drawn as percent


def plot(curves: Mapping[str, Sequence[Row]]) -> str:
    """Loss and validation of both phases, as an SVG file of its own."""
    panels = [
        Panel(f"{what}, phase {phase}", _lines(curves, phase, share=share), share)
        for what, share in (("Loss of the place", False), ("Keyframes of val under 2 cm", True))
        for phase in PHASES
    ]
    width, height = LEFT + WIDTH + RIGHT, TOP + HEIGHT + BELOW
    marks = []
    for place, panel in enumerate(panels):
        at = f"translate({place % 2 * width:g} {24 + place // 2 * height:g})"
        marks.append(element("g", *_drawn(panel), transform=at))
    drawn = element(
        "svg",
        element("rect", width="100%", height="100%", fill="#ffffff"),
        *_legend(),
        *marks,
        xmlns="http://www.w3.org/2000/svg",
        viewBox=f"0 0 {2 * width:g} {24 + 2 * height:g}",
        width=2 * width,
        height=24 + 2 * height,
        font_family="system-ui, sans-serif",
        font_size=12,
        role="img",
        aria_label="Curves of every training; docs/study/curves has the numbers.",
    )
    return str(drawn) + "\n"


def _lines(curves: Mapping[str, Sequence[Row]], phase: str, *, share: bool) -> dict[str, Line]:
    found = {}
    for run, rows in curves.items():
        of_phase = [row for row in rows if row["phase"] == phase]
        kind = "validation" if share else "step"
        line = [
            (row["step"], row["overall"].get(NEAR) if share else row["losses"][SHOWN])
            for row in of_phase
            if row["kind"] == kind
        ]
        if there := [(step, value) for step, value in line if value is not None]:
            found[run] = there
    return found


def _drawn(panel: Panel) -> list[Markup]:
    marks = [
        element("text", panel.title, x=LEFT, y=TOP - 10, font_weight="600", fill="#1f2933"),
        element("rect", x=LEFT, y=TOP, width=WIDTH, height=HEIGHT, fill="none", stroke="#d3dae1"),
    ]
    points = [point for line in panel.lines.values() for point in line]
    if not points:
        middle = {"x": LEFT + WIDTH / 2, "y": TOP + HEIGHT / 2, "text_anchor": "middle"}
        return [*marks, element("text", "no run yet", **middle, fill="#7b8794")]
    steps = max(step for step, _ in points)
    top = 1.0 if panel.share else max(value for _, value in points)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        marks += _tick(tick, top, panel.share)
    marks += [
        element("text", "0", x=LEFT, y=TOP + HEIGHT + 16, fill="#52606d"),
        element("text", f"step {steps:g}", x=LEFT + WIDTH, y=TOP + HEIGHT + 16,
                text_anchor="end", fill="#52606d"),
    ]  # fmt: skip
    order = sorted(panel.lines, key=lambda run: kind_of(run) != "")  # what matters lies on top
    return marks + [_line(run, panel.lines[run], steps, top) for run in order]


def _tick(tick: float, top: float, share: bool) -> list[Markup]:
    y = round(TOP + HEIGHT * (1 - tick), 2)
    label = f"{100 * tick:.0f} %" if share else f"{top * tick:.3g}"
    return [
        element("line", x1=LEFT, x2=LEFT + WIDTH, y1=y, y2=y, stroke="#e7ecf0"),
        element("text", label, x=LEFT - 5, y=y + 4, text_anchor="end", fill="#52606d"),
    ]


def _line(run: str, line: Line, steps: float, top: float) -> Markup:
    places = [
        (round(LEFT + WIDTH * step / steps, 1), round(TOP + HEIGHT * (1 - value / top), 1))
        for step, value in line
    ]
    kind = kind_of(run)
    look = {"stroke": COLORS[kind], "stroke_width": 1.5 if kind else 1.0, "fill": "none"}
    title = element("title", run)
    if len(places) == 1:
        [(x, y)] = places
        return element("circle", title, cx=x, cy=y, r=2.5, fill=COLORS[kind])
    points = " ".join(f"{x:g},{y:g}" for x, y in places)
    return element("polyline", title, points=points, **look)


def kind_of(run: str) -> str:
    """Which colour a run has: those of SEEK and of its twin, the shared one, all others."""
    name = run.rpartition("-s")[0] or run
    return name if name in COLORS else ""


def _legend() -> list[Markup]:
    marks, x = [], LEFT
    for kind, label in LEGEND.items():
        marks += [
            element("line", x1=x, x2=x + 18, y1=16, y2=16, stroke=COLORS[kind], stroke_width=3),
            element("text", label, x=x + 24, y=20, fill="#1f2933"),
        ]
        x += 40 + 7 * len(label)
    return marks
