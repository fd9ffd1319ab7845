"""Failures: episodes of all evaluations or of one, by what they differ in, each with its reason."""

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any, NamedTuple

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.contract import Category, Failure
from server import episodes, evaluations, facets, labels, partings
from server.access import Router, Scope, needs
from server.deps import Reading
from server.schemas.episodes import EpisodePublic, FailureGroup, LabelPublic, PartingPublic
from web.facets import chosen, shown_facets
from web.filters import Filters
from web.templating import page

router = Router(include_in_schema=False)

SHOWN = 30  # cards of a page
Filtered = Annotated[Filters, Query()]


class Card(NamedTuple):
    """An episode with what is said of it."""

    episode: EpisodePublic
    asked: datetime  # when its evaluation was
    parting: PartingPublic | None  # from the expert, if it played the same
    labels: list[LabelPublic]  # that stand


@router.get("/failures")
@needs(Scope.READ)
def show_all_failures(request: Request, session: Reading, filters: Filtered) -> HTMLResponse:
    """What went wrong in all evaluations."""
    return _page(request, session, filters)


@router.get("/evaluations/{id}/failures")
@needs(Scope.READ)
def show_failures(request: Request, session: Reading, id: str, filters: Filtered) -> HTMLResponse:
    """What went wrong in one evaluation."""
    evaluations.row(session, id)
    return _page(request, session, filters.model_copy(update={"evaluation": [id]}))


def _page(request: Request, session: Session, filters: Filters) -> HTMLResponse:
    filters.require_known()
    scope = [evaluations.get(session, id) for id in filters.evaluation]
    found = episodes.listed(session, limit=SHOWN, cursor=filters.cursor, **filters.wanted())
    counted = facets.facets(session, filters.asked)
    anywhere = filters.asked.without("category", "task", "failure", "hidden", "variation")
    groups = episodes.failure_groups(session, **dict(anywhere))
    shown = {
        "filters": filters,
        "evaluation": scope[0] if len(scope) == 1 else None,
        "scope": scope,
        "total": counted.episodes,
        "facets": shown_facets(filters, counted),
        "chosen": chosen(session, filters, empty=not counted.episodes),
        "cards": cards(session, found.items),
        "next": found.next,
        "table": failure_table(groups),
        "names": sorted({group.failure for group in groups}, key=list(Failure).index),
        "most": max((group.episodes for group in groups), default=1),
        "used": labels.counted(session),
        **(_why_empty(session, filters) if not counted.episodes else {"why_empty": ""}),
    }
    return page(request, "failures.html", shown)


def cards(session: Session, found: Sequence[EpisodePublic]) -> list[Card]:
    """The episodes with where each parts from the expert, and its labels."""
    ids = [one.id for one in found]
    parts = partings.from_expert(session, ids)
    said = labels.of_episodes(session, ids)
    asked = {id: evaluations.row(session, id).created for id in {one.evaluation for one in found}}
    return [_card(one, asked[one.evaluation], parts.get(one.id), said[one.id]) for one in found]


def _card(
    episode: EpisodePublic,
    asked: datetime,
    parts: PartingPublic | None,
    said: Sequence[LabelPublic],
) -> Card:
    return Card(episode, asked, parts, [one for one in said if not one.withdrawn])


def _why_empty(session: Session, filters: Filters) -> dict[str, Any]:
    """Whether nothing was evaluated, nothing failed, or only nothing matches."""
    scope = filters.asked.model_validate({"evaluation": filters.evaluation})
    final = facets.count(session, scope.model_copy(update={"state": ["final"]}))
    failed = facets.count(session, scope.model_copy(update={"verdict": ["inexact"]}))
    if not final:
        return {"why_empty": "not evaluated"}
    alone = not filters.fields(evaluation=None, sort=None).keys() - {"evaluation", "sort"}
    return {"why_empty": "not failed" if alone and not failed else "no match", "final": final}


def failure_table(
    groups: Sequence[FailureGroup],
) -> dict[tuple[Category, str], dict[Failure, int]]:
    """Counts by category and task, then by failure."""
    rows: dict[tuple[Category, str], dict[Failure, int]] = {}
    order = list(Category)
    for group in sorted(groups, key=lambda one: (order.index(one.category), one.task)):
        rows.setdefault((group.category, group.task), {})[group.failure] = group.episodes
    return rows
