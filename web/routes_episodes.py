"""One episode: its replay, its hidden state over time, its decisions."""

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from pydantic import Field
from sqlalchemy.orm import Session

from hide_tasks import load
from hide_tasks.contract import Failure, Value
from server import episodes, evaluations, labels, partings, reruns
from server.access import Router, Scope, needs
from server.beliefs import checked
from server.deps import Reading
from server.schemas.episodes import DecisionPublic, EpisodeDetail
from web.beside import beside, offered
from web.filters import Filters
from web.memory_panel import memories
from web.templating import page
from web.timeline import Timeline
from web.viewer_assets import SCRIPT, ViewerAssets, layout_for

router = Router(include_in_schema=False)


class View(Filters):
    """Where the reader is: the filter that led here, the decision, the other run."""

    at: Annotated[int, Field(ge=0)] | None = None
    beside: str | None = None

    def fields(self, **changed: object) -> dict[str, Any]:
        """The filter alone: it goes along to the neighbours."""
        own = {"at", "beside"}
        return {k: v for k, v in super().fields(**changed).items() if k not in own or k in changed}


@router.get("/episodes/{id}")
@needs(Scope.READ)
def show_episode(
    request: Request, session: Reading, id: str, view: Annotated[View, Query()]
) -> HTMLResponse:
    """One episode with its replay."""
    viewer: ViewerAssets = request.app.state.viewer
    episode = episodes.get(session, id)
    before, after = neighbours(session, episode, view)
    cameras = load(episode.task).cameras
    layout = f"{layout_for(cameras)}?v={viewer.layout_version}"
    shown = {
        "episode": episode,
        "evaluation": evaluations.get(session, episode.evaluation),
        "before": before,
        "after": after,
        "filters": view,
        "labels": labels.of_episode(session, id),
        "used": labels.counted(session),
        "cameras": cameras,
        "script": f"/viewer/{viewer.version}/{SCRIPT}",
        "layout": f"/viewer/{viewer.version}/{layout}",
        "again": reruns.rerun(session, id),
        "actions_file": reruns.actions_file(episode),
        **played(session, episode, view),
    }
    return page(request, "episode.html", shown)


def played(session: Session, episode: EpisodeDetail, view: View) -> dict[str, Any]:
    """What happened in it, and in the run beside it."""
    decisions = episodes.decisions(session, episode.id)
    spans = episodes.spans(session, episode.id)
    beliefs = checked(episode, decisions)
    timeline = Timeline(episode, decisions, spans, beliefs) if spans or decisions else None
    runs = partings.runs_of_same(session, episode.id)
    other = beside(session, episode.id, decisions, view.beside) if view.beside else None
    expert = offered(runs)
    known = partings.from_expert(session, [episode.id]) if expert and not other else {}
    parting = other.parting if other else known.get(episode.id)
    if timeline and parting and parting.decision is not None:
        timeline.parted = parting.time_a
    if timeline and other:
        timeline.scale = other.timeline.scale = max(timeline.end, other.timeline.end)
    return {
        "decisions": rows_of(episode, decisions),
        "at": min(view.at or 0, len(decisions)),
        "timeline": timeline,
        "beliefs": beliefs,
        "memories": memories(decisions, beliefs),
        "runs": runs,
        "expert": expert,
        "parting": parting,
        "beside": other,
    }


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
