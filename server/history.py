"""How an evaluation went in wall time: who played when, and why nobody did.

All of it is derived: from the events, which keep when each episode began and ended, also in tries
that were lost, and from the attempts. Nothing is kept up for it.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from server import lanes
from server.lanes import Spans
from server.models import Attempt, Evaluation, Event, Policy, PolicyVersion, Shard, now
from server.schemas import (
    Activity,
    HistoryPublic,
    Phase,
)
from server.states import ENDED, AttemptState, EvaluationState

SHORTEST = timedelta(seconds=1)  # of a phase that is told apart from its neighbours
MOST_NAMED = 3  # evaluations that were played meanwhile
STOPPED = "the server stopped"  # as lifecycle.recover says it


class Gap(NamedTuple):
    """From one moment to another."""

    start: datetime
    end: datetime


def of(session: Session, evaluation: Evaluation) -> HistoryPublic:
    """When which episode was played in which lane, and what each moment was spent on."""
    until = evaluation.ended if evaluation.state in ENDED and evaluation.ended else now()
    attempts = _attempts(session, evaluation.id)
    spans = lanes.spans(session, evaluation.id)
    phases = list(_phases(session, evaluation, attempts, spans, until))
    totals: dict[Activity, float] = defaultdict(float)
    for phase in phases:
        totals[phase.activity] += (phase.end - phase.start).total_seconds()
    return HistoryPublic(
        start=evaluation.created,
        end=until,
        running=evaluation.state not in ENDED,
        lanes=lanes.lanes(attempts, spans, until),
        phases=phases,
        seconds=dict(totals),
    )


def _attempts(session: Session, id: str) -> list[Attempt]:
    wanted = select(Attempt).join(Shard).where(Shard.evaluation_id == id)
    return list(session.scalars(wanted.order_by(Attempt.leased, Attempt.id)))


# --- what the time was spent on ---


def _phases(
    session: Session,
    evaluation: Evaluation,
    attempts: Sequence[Attempt],
    spans: Spans,
    until: datetime,
) -> Iterator[Phase]:
    held = _merged(Gap(one.leased, one.ended or until) for one in attempts)
    at = evaluation.created
    for phase in sorted(_played(attempts, spans, until), key=lambda one: one.start):
        start = max(at, phase.start)
        yield from _between(session, evaluation, attempts, held, Gap(at, start))
        if phase.end > start:
            yield phase.model_copy(update={"start": start})
            at = phase.end
    yield from _between(session, evaluation, attempts, held, Gap(at, until))


def _played(attempts: Sequence[Attempt], spans: Spans, until: datetime) -> Iterator[Phase]:
    """When somebody played, and when in vain; these may overlap."""
    everything = [span for group in spans.values() for span in group]
    kept = (span for span in everything if span.outcome != "lost")
    for gap in _merged(Gap(span.start, span.end or until) for span in kept):
        yield Phase(activity="playing", start=gap.start, end=gap.end, detail="")
    for span in everything:
        if span.outcome == "lost" and span.end:
            yield _in_vain(attempts, span.start, span.end)


def _in_vain(attempts: Sequence[Attempt], start: datetime, end: datetime) -> Phase:
    reasons = [one.reason for one in attempts if one.reason and one.ended and one.ended >= end]
    reason = reasons[0] if reasons else "its episode was put back"
    if reason == STOPPED:
        detail = "the server stopped, and took its work back when it ran again"
        return Phase(activity="stopped", start=start, end=end, detail=detail)
    return Phase(activity="lost", start=start, end=end, detail=f"a try was lost: {reason}")


def _between(
    session: Session,
    evaluation: Evaluation,
    attempts: Sequence[Attempt],
    held: Sequence[Gap],
    gap: Gap,
) -> Iterator[Phase]:
    """What a stretch without a playing worker was: handed out, and waiting before and after."""
    at = gap.start
    for one in [*held, Gap(gap.end, gap.end)]:
        start, end = max(one.start, at), min(one.end, gap.end)
        if start > gap.end or end < at:
            continue
        if start - at >= SHORTEST:
            yield _waiting(session, evaluation, attempts, Gap(at, start))
        if end - start >= SHORTEST:
            detail = "handed out to a worker, which starts or loads the policy"
            yield Phase(activity="starting", start=start, end=end, detail=detail)
        at = max(at, end)


def _waiting(
    session: Session, evaluation: Evaluation, attempts: Sequence[Attempt], gap: Gap
) -> Phase:
    before = [one for one in attempts if one.ended and one.ended <= gap.start]
    lost = before[-1] if before and before[-1].state == AttemptState.LOST else None
    activity: Activity = "waiting" if attempts and attempts[0].leased < gap.start else "queued"
    if _was_incomplete(session, evaluation.id, gap):
        detail = "incomplete, until it was resumed"
        return Phase(activity="incomplete", start=gap.start, end=gap.end, detail=detail)
    detail = _played_meanwhile(session, evaluation.id, gap) or "no worker was free, or none ran"
    if lost:
        detail = f"after an attempt was lost ({lost.reason}): {detail}"
    return Phase(activity=activity, start=gap.start, end=gap.end, detail=detail)


def _was_incomplete(session: Session, id: str, gap: Gap) -> bool:
    newest = session.scalar(
        select(Event)
        .where(Event.evaluation_id == id, Event.kind == "evaluation", Event.time <= gap.start)
        .order_by(Event.seq.desc())
        .limit(1)
    )
    return bool(newest and newest.payload["state"] == EvaluationState.INCOMPLETE)


def _played_meanwhile(session: Session, id: str, gap: Gap) -> str:
    """Other evaluations that workers held meanwhile, in words."""
    rows = session.execute(
        select(Policy.name, PolicyVersion.number, func.count(func.distinct(Attempt.id)))
        .select_from(Attempt)
        .join(Shard, Attempt.shard_id == Shard.id)
        .join(Evaluation, Shard.evaluation_id == Evaluation.id)
        .join(PolicyVersion, Evaluation.policy_version_id == PolicyVersion.id)
        .join(Policy, PolicyVersion.policy_id == Policy.id)
        .where(
            Evaluation.id != id,
            Attempt.leased < gap.end,
            or_(Attempt.ended.is_(None), Attempt.ended > gap.start),
        )
        .group_by(Policy.name, PolicyVersion.number)
        .order_by(func.count(func.distinct(Attempt.id)).desc(), Policy.name)
    ).all()
    if not rows:
        return ""
    named = [f"{name}@{number}" for name, number, _ in rows[:MOST_NAMED]]
    more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
    return f"workers played {', '.join(named)}{more}"


def _merged(gaps: Iterable[Gap]) -> list[Gap]:
    """The same stretches without overlaps, in order; ones that nearly touch are one."""
    found: list[Gap] = []
    for gap in sorted(gaps):
        if found and gap.start - found[-1].end < SHORTEST:
            found[-1] = Gap(found[-1].start, max(found[-1].end, gap.end))
        else:
            found.append(gap)
    return found
