"""A policy's memory in a recording: what it holds to be done, and what it looks back at.

A belief stands at the decision that was chosen by it, beside the truth at that moment.
"""

from collections.abc import Iterator, Sequence

import rerun as rr

from hide_tasks.contract import Attention, Belief
from workers.recording_layout import (
    ATTENTION,
    BELIEF,
    SHADES,
    SIGNALS,
    Lanes,
    Moment,
    Rows,
    as_text,
)

FULL = 10  # marks of a bar that stands for all attention


class MemoryTrack:
    """Takes beliefs, and draws them as lanes, as numbers over time, and as a table."""

    def __init__(self, rows: Rows, lanes: Lanes):
        self._rows, self._lanes = rows, lanes
        self._colors: dict[str, tuple[int, int, int]] = {}  # of a slot, in every view the same
        self._series: set[str] = set()
        self._unexplained: dict[str, rr.SeriesLines] = {}

    def tell(self, belief: Belief, chosen: Moment) -> None:
        """Take what was believed when a decision was chosen."""
        held = {
            "stage_count": belief.stage_count,
            "anchor_index": belief.anchor_index,
            "window": None if belief.window is None else [*belief.window],
        }
        known = {name: value for name, value in held.items() if value is not None}
        self._lanes.set(BELIEF, chosen, known)
        self._signal(f"{SIGNALS}/anchor_similarity", chosen, belief.anchor_similarity)
        self._signal(f"{SIGNALS}/boundary", chosen, belief.boundary)
        for one in belief.attention:
            self._signal(self._entity(one), chosen, one.weight)
        document = {"text": summary(belief), "media_type": "text/markdown"}
        self._rows.add(ATTENTION, rr.TextDocument, chosen, **document)

    def explain(self, stream: rr.RecordingStream) -> None:
        """Write names and colours of the series that are new."""
        for entity, style in self._unexplained.items():
            stream.log(entity, style, static=True)
        self._unexplained.clear()

    def _signal(self, entity: str, moment: Moment, value: float | None) -> None:
        if value is not None:
            self._rows.add(entity, rr.Scalars, moment, scalars=value)

    def _entity(self, one: Attention) -> str:
        path = rr.new_entity_path([one.view, one.slot]).lstrip("/")
        entity = f"{ATTENTION}/{path}"
        color = self._colors.setdefault(one.slot, SHADES[len(self._colors) % len(SHADES)])
        if entity not in self._series:
            self._series.add(entity)
            name = f"{one.view}: {one.slot}"
            self._unexplained[entity] = rr.SeriesLines(names=name, colors=[color])
        return entity


def summary(belief: Belief) -> str:
    """A belief as Markdown: its values in a line, then a table of slots by views."""
    return "\n".join([" · ".join(values(belief)), "", *table(belief.attention)])


def values(belief: Belief) -> Iterator[str]:
    """What is believed, value by value."""
    if belief.stage_count is not None:
        yield f"stages done **{belief.stage_count}**"
    if belief.boundary is not None:
        yield f"a stage ends **{percent(belief.boundary)}**"
    if belief.window is not None:
        yield f"window **{as_text([*belief.window])}**"
    if belief.anchor_index is not None:
        yield f"anchor **{belief.anchor_index}**"
    if belief.anchor_similarity is not None:
        yield f"similarity **{belief.anchor_similarity:.2f}**"


def table(attention: Sequence[Attention]) -> Iterator[str]:
    """Rows of Markdown: a slot a row, a view a column, the most of a view in bold."""
    views = list(dict.fromkeys(one.view for one in attention))
    slots = list(dict.fromkeys(one.slot for one in attention))
    weight = {(one.view, one.slot): one.weight for one in attention}
    most = {view: max(weight.get((view, slot), 0.0) for slot in slots) for view in views}
    if views:
        yield f"| looks at | {' | '.join(map(plain, views))} |"
        yield "|---" * (1 + len(views)) + "|"
    for slot in slots:
        cells = [cell(weight.get((view, slot)), most[view]) for view in views]
        yield f"| {plain(slot)} | {' | '.join(cells)} |"


def cell(weight: float | None, most: float) -> str:
    """A share of attention as percent and as a bar."""
    if weight is None:
        return "–"
    text = f"{percent(weight)} {'▂' * round(FULL * weight)}"
    return f"**{text}**" if weight == most else text


def percent(share: float) -> str:
    """A share as whole percent."""
    return f"{100 * share:.0f} %"


def plain(name: str) -> str:
    """A policy's own name without what would break a table."""
    return name.replace("|", "/").replace("\n", " ")
