"""Episodes of evaluations: looked up, filtered, with their decisions and spans."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from sqlalchemy import func, select, tuple_
from sqlalchemy.orm import Session, defer, selectinload

from hide_tasks import load
from hide_tasks.contract import Category, Failure, Rules
from server.episode_order import Sort, beyond, kinds, ordered, place
from server.matching import conditions
from server.models import Decision, Episode, HiddenChange, HiddenSpan
from server.paging import after, page
from server.problems import Problem, not_found
from server.schemas.common import Page
from server.schemas.episodes import (
    ChangePublic,
    DecisionPublic,
    EpisodeDetail,
    EpisodePublic,
    FailureGroup,
    SpanPublic,
)
from server.states import EpisodeState
from server.wanted import Wanted

PARITY_BUDGET = 25  # decisions; hide_tasks.episode has it too, but brings the simulator along


def row(session: Session, id: str) -> Episode:
    """The episode with this id.

    Raises:
        Problem: 404, there is none.
    """
    if found := session.get(Episode, id):
        return found
    raise not_found("episode", id)


def get(session: Session, id: str) -> EpisodeDetail:
    """The episode with this id and what a reader wants beside it.

    Raises:
        Problem: 404, there is none.
    """
    episode = row(session, id)
    checks = select(Decision.checks).where(Decision.episode_id == id)
    last = session.scalar(checks.order_by(Decision.number.desc()).limit(1))
    start = episode.start or {}
    return EpisodeDetail.model_validate(
        _fields(episode)
        | {
            "start": episode.start,
            "checks": last if last is not None else start.get("checks", {}),
            "previous": _neighbour(session, episode, forwards=False),
            "next": _neighbour(session, episode, forwards=True),
        }
    )


def budget(episode: Episode) -> int:
    """How many decisions the episode may take."""
    rules: Rules = "parity" if episode.evaluation.rules == "parity" else "hide"
    return PARITY_BUDGET if rules == "parity" else load(episode.task).budget()


def _neighbour(session: Session, episode: Episode, *, forwards: bool) -> str | None:
    here, there = tuple_(episode.task, episode.index), tuple_(Episode.task, Episode.index)
    order = (Episode.task, Episode.index)
    return session.scalar(
        select(Episode.id)
        .where(
            Episode.evaluation_id == episode.evaluation_id,
            there > here if forwards else there < here,
        )
        .order_by(*(order if forwards else [column.desc() for column in order]))
        .limit(1)
    )


def listed(
    session: Session,
    *,
    sort: Sort = Sort.NEWEST,
    limit: int = 50,
    cursor: str | None = None,
    **wanted: Any,
) -> Page[EpisodePublic]:
    """Episodes that are wanted (`server.wanted.Wanted`), in order.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    # Joined, each evaluation would come as often as it has episodes.
    whole = selectinload(Episode.evaluation), defer(Episode.start)
    found = select(Episode).options(*whole).where(*conditions(Wanted(**wanted)))
    if at := after(cursor, kinds(sort)):
        found = found.where(beyond(sort, at))
    rows = session.scalars(found.order_by(*ordered(sort)).limit(limit + 1)).all()
    return page(rows, limit, lambda one: place(one, sort), public)


def beside(
    session: Session, id: str, *, sort: Sort = Sort.NEWEST, **wanted: Any
) -> tuple[str | None, str | None] | None:
    """The episodes before and after this one among those that are wanted; None if it is not.

    Raises:
        Problem: 404, there is no such episode.
    """
    found = select(Episode.id).where(*conditions(Wanted(**wanted)))
    at = place(row(session, id), sort)
    if session.scalar(found.where(Episode.id == id)) is None:
        return None
    before, next_ = (
        session.scalar(
            found.where(beyond(sort, at, back=back)).order_by(*ordered(sort, back=back)).limit(1)
        )
        for back in (True, False)
    )
    return before, next_


@dataclasses.dataclass(frozen=True, slots=True)
class Cell:
    """What the grid of an evaluation shows of an episode."""

    id: str
    task: str
    category: Category
    index: int
    state: EpisodeState
    success: bool | None
    exact: bool | None
    failure: Failure | None


def cells(session: Session, evaluation: str) -> list[Cell]:
    """Every episode of an evaluation, by task and index."""
    wanted = select(*(getattr(Episode, one.name) for one in dataclasses.fields(Cell)))
    of_it = wanted.where(Episode.evaluation_id == evaluation)
    return [
        Cell(id, task, Category(category), index, EpisodeState(state), success, exact, failure)
        for id, task, category, index, state, success, exact, failure in session.execute(
            of_it.order_by(Episode.task, Episode.index)
        )
    ]


def decisions(session: Session, id: str) -> list[DecisionPublic]:
    """The decisions of an episode, in order; none while it is not final.

    Raises:
        Problem: 404, there is no such episode.
    """
    row(session, id)
    found = select(Decision).where(Decision.episode_id == id).order_by(Decision.number)
    return [DecisionPublic.model_validate(_decision(one)) for one in session.scalars(found)]


def decisions_of(session: Session, ids: Iterable[str]) -> dict[str, list[DecisionPublic]]:
    """The decisions of several episodes, in order; those without any are left out."""
    found: dict[str, list[DecisionPublic]] = {}
    wanted = select(Decision).where(Decision.episode_id.in_(ids))
    for one in session.scalars(wanted.order_by(Decision.episode_id, Decision.number)):
        decision = DecisionPublic.model_validate(_decision(one))
        found.setdefault(one.episode_id, []).append(decision)
    return found


def _decision(one: Decision) -> dict[str, Any]:
    fields = {
        name: getattr(one, name) for name in DecisionPublic.model_fields if name != "decision"
    }
    return fields | {"decision": one.number}


def spans(session: Session, id: str) -> list[SpanPublic]:
    """What held how long in an episode: hidden values, then the stage, then beliefs.

    Raises:
        Problem: 404, there is no such episode.
    """
    row(session, id)
    order = ("hidden", "stage", "belief")
    found = select(HiddenSpan).where(HiddenSpan.episode_id == id)
    rows = sorted(
        session.scalars(found), key=lambda one: (order.index(one.kind), one.name, one.number)
    )
    return [
        SpanPublic.model_validate({name: getattr(one, name) for name in SpanPublic.model_fields})
        for one in rows
    ]


def changes(session: Session, id: str) -> list[ChangePublic]:
    """The hidden state at the start and after each of its changes.

    Raises:
        Problem: 404, there is no such episode.
    """
    row(session, id)
    found = select(HiddenChange).where(HiddenChange.episode_id == id).order_by(HiddenChange.number)
    return [
        ChangePublic.model_validate(
            {name: getattr(one, name) for name in ChangePublic.model_fields}
        )
        for one in session.scalars(found)
    ]


def failure_groups(session: Session, **wanted: Any) -> list[FailureGroup]:
    """How many of the episodes that are wanted failed in which way, most frequent first."""
    count = func.count()
    found = session.execute(
        select(Episode.category, Episode.task, Episode.failure, count)
        .where(*conditions(Wanted(**wanted)), Episode.failure.is_not(None))
        .group_by(Episode.category, Episode.task, Episode.failure)
        .order_by(count.desc(), Episode.task, Episode.failure)
    )
    return [
        FailureGroup.model_validate(
            {"category": category, "task": task, "failure": failure, "episodes": number}
        )
        for category, task, failure, number in found
    ]


def public(episode: Episode) -> EpisodePublic:
    """An episode as the API gives it out."""
    return EpisodePublic.model_validate(_fields(episode))


def _fields(episode: Episode) -> dict[str, Any]:
    own = {"evaluation", "policy", "version", "budget", "recording", "recording_removed", "live"}
    own |= {"thumbnail", "preview"}
    fields = {n: getattr(episode, n) for n in EpisodePublic.model_fields if n not in own}
    path = f"/api/v1/episodes/{episode.id}"
    live = episode.state == EpisodeState.RUNNING and episode.evaluation.recordings
    return fields | {
        "evaluation": episode.evaluation_id,
        "policy": episode.evaluation.policy_version.policy.name,
        "version": episode.evaluation.policy_version.number,
        "budget": budget(episode),
        "recording": f"{path}/recording.rrd" if _is_kept(episode) or live else None,
        "recording_removed": episode.removal and episode.removal.time,
        "live": live,
        "preview": f"{path}/preview.webp" if _is_kept(episode) else None,
        "thumbnail": f"{path}/thumbnail.jpg" if episode.thumbnail else None,
    }


def recording_of(episode: Episode) -> str | None:
    """The SHA-256 of an episode's recording; None if it was played without one.

    Raises:
        Problem: 410, it was removed to make room.
    """
    if episode.removal is not None:
        when = f"{episode.removal.time:%Y-%m-%d}"
        detail = f"The recording was removed on {when} to make room ({episode.removal.reason})."
        raise Problem(410, "recording_removed", detail)
    return episode.recording


def _is_kept(episode: Episode) -> bool:
    return episode.recording is not None and episode.removal is None
