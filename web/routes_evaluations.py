"""Evaluations: the list, the form, the live grid."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Annotated

from fastapi import Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from sqlalchemy.orm import Session

from server import episodes, evaluations, policies
from server.access import Router, Scope, needs
from server.deps import Reading
from server.episodes import Cell
from server.schemas import AttemptPublic, RatePublic, Verdicts
from server.states import ENDED, AttemptState, EvaluationState
from web.filters import EMPTY_IS_NONE
from web.templating import KeptParts, page, part

router = Router(include_in_schema=False)

LISTED = 50
grids = KeptParts(300)  # of evaluations that have ended: 100 kB each of the whole suite


@router.get("/evaluations")
@needs(Scope.READ)
def list_evaluations(
    request: Request,
    session: Reading,
    state: Annotated[EvaluationState | None, EMPTY_IS_NONE] = None,
    policy: Annotated[str | None, EMPTY_IS_NONE] = None,
    cursor: str | None = None,
) -> HTMLResponse:
    """Evaluations, latest first."""
    found = evaluations.listed(session, state=state, policy=policy, limit=LISTED, cursor=cursor)
    names = list(dict.fromkeys(version.policy for version in policies.versions(session)))
    shown = {
        "found": found,
        "states": list(EvaluationState),
        "policies": names,
        "state": state,
        "policy": policy,
        "cursor": cursor,
    }
    return page(request, "evaluations.html", shown)


@router.get("/evaluations/{id}")
@needs(Scope.READ)
def show_evaluation(request: Request, session: Reading, id: str) -> HTMLResponse:
    """One evaluation as it stands; a script keeps it up to date."""
    evaluation = evaluations.get(session, id)
    ended = evaluation.state in ENDED
    shown = {
        "evaluation": evaluation,
        "ended": ended,
        "grid": grids.kept((id, evaluation.last_event), lambda: grid(session, id))
        if ended
        else grid(session, id),
        "lost": lost(evaluations.attempts(session, id)),
    }
    return page(request, "evaluation.html", shown)


def grid(session: Session, id: str) -> Markup:
    """Every episode as a cell, with each task's rates."""
    by_task: dict[str, list[Cell]] = defaultdict(list)
    for cell in episodes.cells(session, id):
        by_task[cell.task].append(cell)
    rows = {task: (found, verdicts_of(found)) for task, found in by_task.items()}
    return part("grid.html", {"rows": rows})


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
