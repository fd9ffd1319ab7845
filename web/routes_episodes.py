"""One episode: its replay, its hidden state over time, its decisions."""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.contract import Failure, Value
from server import episodes, evaluations
from server.access import Router, Scope, needs
from server.deps import Reading
from server.schemas import DecisionPublic, EpisodeDetail
from web.filters import Filters
from web.templating import page
from web.timeline import Timeline
from web.viewer_assets import LAYOUT, SCRIPT, ViewerAssets

router = Router(include_in_schema=False)


@router.get("/episodes/{id}")
@needs(Scope.READ)
def show_episode(
    request: Request, session: Reading, id: str, filters: Annotated[Filters, Query()]
) -> HTMLResponse:
    """One episode with its replay."""
    viewer: ViewerAssets = request.app.state.viewer
    episode = episodes.get(session, id)
    decisions = episodes.decisions(session, id)
    spans = episodes.spans(session, id)
    before, after = neighbours(session, episode, filters)
    shown = {
        "episode": episode,
        "evaluation": evaluations.get(session, episode.evaluation),
        "decisions": rows_of(episode, decisions),
        "timeline": Timeline(episode, decisions, spans) if spans or decisions else None,
        "before": before,
        "after": after,
        "filters": filters,
        "script": f"/viewer/{viewer.version}/{SCRIPT}",
        "layout": f"/viewer/{viewer.version}/{LAYOUT}?v={viewer.layout_version}",
    }
    return page(request, "episode.html", shown)


def neighbours(
    session: Session, episode: EpisodeDetail, filters: Filters
) -> tuple[str | None, str | None]:
    """The episodes before and after, among those that the filter shows."""
    found = episodes.beside(session, episode.id, **filters.wanted()) if filters.given else None
    return found or (episode.previous, episode.next)


class Row(NamedTuple):
    """A decision as the table shows it."""

    decision: DecisionPublic
    chosen: float  # simulated seconds; what it led to stands at the decision's own time
    changed: dict[str, Value | list[Value]]  # hidden values
    violations: list[Failure]  # that were none before


def rows_of(episode: EpisodeDetail, decisions: Sequence[DecisionPublic]) -> list[Row]:
    """Every decision with what it changed."""
    known: dict[str, Value | list[Value]] = dict(episode.start.hidden) if episode.start else {}
    done: set[Failure] = set()
    time, rows = 0.0, []
    for one in decisions:
        changed = {k: v for k, v in one.hidden.items() if k not in known or known[k] != v}
        violations = [name for name in dict.fromkeys(one.violations) if name not in done]
        rows.append(Row(one, time, changed, violations))
        known, time = one.hidden, one.time
        done.update(violations)
    return rows
