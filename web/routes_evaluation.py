"""One evaluation: its grid, its workers over time, its log, and what is done with it."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from fastapi import Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from sqlalchemy.orm import Session

from hide_tasks.contract import Category
from server import episodes, evaluations, event_log, history, log_tail, publication, waiting
from server.access import Principal, Router, Scope, needs
from server.deps import Reading, TheHub, ThePrincipal
from server.episodes import Cell
from server.hub import Hub
from server.kept import Kept
from server.models import Evaluation, now
from server.schemas.common import RatePublic, Verdicts
from server.schemas.evaluations import AttemptPublic
from server.schemas.history import HistoryPublic
from server.states import ENDED, AttemptState, Desired
from web.templating import page, part
from web.worker_lanes import ACTIVITIES, LanesDrawing, summary, waits

router = Router(include_in_schema=False)

grids: Kept[tuple[str, int], Markup] = Kept(300)  # of what has ended: 100 kB each


@dataclass(frozen=True)
class Playing:
    """An episode that is played now."""

    episode: str
    task: str
    index: int
    seconds: float


@router.get("/evaluations/{id}")
@needs(Scope.READ)
def show_evaluation(
    request: Request, session: Reading, hub: TheHub, principal: ThePrincipal, id: str
) -> HTMLResponse:
    """One evaluation as it stands; a script keeps it up to date."""
    evaluation = evaluations.get(session, id)
    row = evaluations.row(session, id)
    key = (id, evaluation.last_event)
    ended = evaluation.state in ENDED
    shown = {
        "evaluation": evaluation,
        "ended": ended,
        "grid": grids.kept(key, partial(grid, session, id, ended=True))
        if ended
        else grid(session, id),
        "live": live(session, hub, row),
        "publication": publication.of(session, row),
        "printed": _printed(hub, principal),
        "lost": lost(evaluations.attempts(session, id)),
    }
    return page(request, "evaluation.html", shown)


@router.get("/evaluations/{id}/live")
@needs(Scope.READ)
def show_live(session: Reading, hub: TheHub, id: str) -> HTMLResponse:
    """The part of the page that changes all the time: what is played, the lanes, the log."""
    row = evaluations.row(session, id)
    found = live(session, hub, row)
    return HTMLResponse(Markup().join(found), headers={"Cache-Control": "no-cache"})


class Live(NamedTuple):
    """What changes all the time."""

    started: Markup
    now: Markup
    rest: Markup


def live(session: Session, hub: Hub, row: Evaluation) -> Live:
    """What is played now, who played when, and what happened."""
    found = history.of(session, row)
    present = {
        "now_playing": _playing(found),
        "stopping": row.desired == Desired.CANCELLED,
        "place": waiting.place(session, hub, row.id) if row.state not in ENDED else None,
        "held": waiting.handed_out(session, row.id),
    }
    started = part("evaluation_started.html", {"evaluation": row})
    return Live(started, part("evaluation_now.html", present), _rest(session, row, found))


def _rest(session: Session, row: Evaluation, found: HistoryPublic) -> Markup:
    shown = {
        "evaluation": row,
        "history": found,
        "drawing": LanesDrawing(found),
        "summary": summary(found),
        "waits": waits(found),
        "ACTIVITIES": ACTIVITIES,
        "lines": event_log.tail(session, row.id),
    }
    return part("evaluation_live.html", shown)


def _playing(found: HistoryPublic) -> list[Playing]:
    if not found.running:
        return []
    return [
        Playing(span.episode, span.task, span.index, (now() - span.start).total_seconds())
        for lane in found.lanes
        for span in lane.spans
        if span.outcome == "running"
    ]


def _printed(hub: Hub, principal: Principal) -> Sequence[str]:
    """What workers printed, for whoever may read what other people's policies say."""
    return log_tail.of(hub).lines if principal.may(Scope.MAINTAIN) else ()


def grid(session: Session, id: str, *, ended: bool = False) -> Markup:
    """Every episode as a cell, with each task's rates, by category.

    Args:
        ended: what was not played waits no more.
    """
    by_task: dict[str, list[Cell]] = defaultdict(list)
    for cell in episodes.cells(session, id):
        by_task[cell.task].append(cell)
    rows = {task: (found, verdicts_of(found)) for task, found in by_task.items()}
    kinds = [
        (kind, {task: row for task, row in rows.items() if row[0][0].category == kind})
        for kind in Category
    ]
    shown = [_kind(kind, some) for kind, some in kinds if some]
    return part("grid.html", {"kinds": shown, "ended": ended})


def _kind(kind: Category, rows: dict[str, Any]) -> dict[str, Any]:
    cells = [cell for found, _ in rows.values() for cell in found]
    return {"kind": kind, "rows": rows, "verdicts": verdicts_of(cells)}


def verdicts_of(found: Sequence[Cell]) -> Verdicts:
    """Both verdicts over the episodes that are final."""
    final = [episode for episode in found if episode.success is not None]
    success = RatePublic.of(sum(bool(episode.success) for episode in final), len(final))
    exact = RatePublic.of(sum(bool(episode.exact) for episode in final), len(final))
    return Verdicts(success=success, exact=exact)


def lost(attempts: Sequence[AttemptPublic]) -> list[AttemptPublic]:
    """The attempts that were lost, latest first."""
    found = [attempt for attempt in attempts if attempt.state is AttemptState.LOST]
    return sorted(found, key=lambda attempt: attempt.leased, reverse=True)
