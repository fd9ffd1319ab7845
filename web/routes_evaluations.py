"""Evaluations: the list, the form, the live grid, the failures."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.contract import Category, Failure
from server import episodes, evaluations, policies
from server.access import Router, Scope, needs
from server.deps import Reading
from server.paging import MOST
from server.schemas import EpisodePublic, FailureGroup
from server.states import EvaluationState
from web.filters import EMPTY_IS_NONE, Filters
from web.templating import KeptParts, page

router = Router(include_in_schema=False)

LISTED = 50
PICTURES = 60
grids = KeptParts(300)  # of evaluations that have ended: 100 kB each of the whole suite
Filtered = Annotated[Filters, Query()]


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


@router.get("/evaluations/{id}/failures")
@needs(Scope.READ)
def show_failures(request: Request, session: Reading, id: str, filters: Filtered) -> HTMLResponse:
    """What went wrong, counted, and the episodes of it."""
    evaluation = evaluations.get(session, id)
    groups = episodes.failure_groups(session, evaluation=id)
    wanted = filters.wanted()
    found = episodes.listed(session, evaluation=id, limit=PICTURES, cursor=filters.cursor, **wanted)
    shown = {
        "evaluation": evaluation,
        "table": failure_table(groups),
        "names": sorted({group.failure for group in groups}, key=list(Failure).index),
        "most": max((group.episodes for group in groups), default=1),
        "total": sum(group.episodes for group in groups),
        "found": found,
        "filters": filters,
    }
    return page(request, "failures.html", shown)


def all_episodes(session: Session, id: str, **wanted: Any) -> Iterator[EpisodePublic]:
    """Every episode of an evaluation, or those that are wanted."""
    cursor = None
    while True:
        found = episodes.listed(session, evaluation=id, limit=MOST, cursor=cursor, **wanted)
        yield from found.items
        cursor = found.next
        if not cursor:
            return


def failure_table(
    groups: Sequence[FailureGroup],
) -> dict[tuple[Category, str], dict[Failure, int]]:
    """Counts by category and task, then by failure."""
    rows: dict[tuple[Category, str], dict[Failure, int]] = {}
    order = list(Category)
    for group in sorted(groups, key=lambda one: (order.index(one.category), one.task)):
        rows.setdefault((group.category, group.task), {})[group.failure] = group.episodes
    return rows
