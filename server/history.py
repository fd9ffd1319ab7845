"""How an evaluation went in wall time: who played when, and why nobody did.

All of it is derived: from the events, which keep when each episode began and ended, also in tries
that were lost, and from the attempts. Nothing is kept up for it.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from functools import cached_property
from typing import NamedTuple

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from server import lanes
from server.lanes import Spans
from server.models import Attempt, Evaluation, Event, Policy, PolicyVersion, Shard, now
from server.schemas.history import Activity, HistoryPublic, Phase
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
    meanwhile = _Meanwhile(session, evaluation, until)
    phases = list(_phases(meanwhile, attempts, spans, Gap(evaluation.created, until)))
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
    meanwhile: "_Meanwhile", attempts: Sequence[Attempt], spans: Spans, whole: Gap
) -> Iterator[Phase]:
    held = _merged(Gap(one.leased, one.ended or whole.end) for one in attempts)
    at = whole.start
    for phase in sorted(_played(attempts, spans, whole.end), key=lambda one: one.start):
        start = max(at, phase.start)
        yield from _between(meanwhile, attempts, held, Gap(at, start))
        if phase.end > start:
            yield phase.model_copy(update={"start": start})
            at = phase.end
    yield from _between(meanwhile, attempts, held, Gap(at, whole.end))


def _played(attempts: Sequence[Attempt], spans: Spans, until: datetime) -> Iterator[Phase]:
    """When somebody played, and when in vain; these may overlap."""
    everything = [span for group in spans.values() for span in group]
    kept = (span for span in everything if span.outcome != "lost")
    for gap in _merged(Gap(span.start, span.end or until) for span in kept):
        yield Phase(activity="playing", start=gap.start, end=gap.end, detail="")
    for shard, group in spans.items():
        own = [one for one in attempts if one.shard_id == shard]
        for span in group:
            if span.outcome == "lost" and span.end:
                yield _in_vain(own, span.start, span.end)


def _in_vain(attempts: Sequence[Attempt], start: datetime, end: datetime) -> Phase:
    """What was lost of a shard, of which these are the tries."""
    reasons = [one.reason for one in attempts if one.reason and one.ended and one.ended >= end]
    reason = reasons[0] if reasons else "its episode was put back"
    if reason == STOPPED:
        detail = "the server stopped, and took its work back when it ran again"
        return Phase(activity="stopped", start=start, end=end, detail=detail)
    return Phase(activity="lost", start=start, end=end, detail=f"a try was lost: {reason}")


def _between(
    meanwhile: "_Meanwhile", attempts: Sequence[Attempt], held: Sequence[Gap], gap: Gap
) -> Iterator[Phase]:
    """What a stretch without a playing worker was: handed out, and waiting before and after."""
    at = gap.start
    for one in [*held, Gap(gap.end, gap.end)]:
        start, end = max(one.start, at), min(one.end, gap.end)
        if start > gap.end or end < at:
            continue
        if start - at >= SHORTEST:
            yield _waiting(meanwhile, attempts, Gap(at, start))
        if end - start >= SHORTEST:
            detail = "handed out to a worker, which starts or loads the policy"
            yield Phase(activity="starting", start=start, end=end, detail=detail)
        at = max(at, end)


def _waiting(meanwhile: "_Meanwhile", attempts: Sequence[Attempt], gap: Gap) -> Phase:
    before = [one for one in attempts if one.ended and one.ended <= gap.start]
    lost = before[-1] if before and before[-1].state == AttemptState.LOST else None
    activity: Activity = "waiting" if attempts and attempts[0].leased < gap.start else "queued"
    if meanwhile.was_incomplete(gap):
        detail = "incomplete, until it was resumed"
        return Phase(activity="incomplete", start=gap.start, end=gap.end, detail=detail)
    detail = meanwhile.played(gap) or "no worker was free, or none ran"
    if lost:
        detail = f"after an attempt was lost ({lost.reason}): {detail}"
    return Phase(activity=activity, start=gap.start, end=gap.end, detail=detail)


class _Held(NamedTuple):
    """What a worker held: an attempt, of which policy's version, from when to when."""

    name: str
    number: int
    leased: datetime
    ended: datetime | None


class _Meanwhile:
    """What happened beside the playing, asked for once: it may wait before each of its shards.

    Args:
        until: the end of what is looked at.
    """

    def __init__(self, session: Session, evaluation: Evaluation, until: datetime):
        self._session, self._evaluation, self._until = session, evaluation, until

    def was_incomplete(self, gap: Gap) -> bool:
        """True if the evaluation was, when the stretch began."""
        before = [state for time, state in self._states if time <= gap.start]
        return bool(before) and before[-1] == EvaluationState.INCOMPLETE

    def played(self, gap: Gap) -> str:
        """Other evaluations that workers held meanwhile, in words."""
        counted = Counter(
            (one.name, one.number)
            for one in self._others
            if one.leased < gap.end and (one.ended is None or one.ended > gap.start)
        )
        ranked = sorted(counted, key=lambda one: (-counted[one], one))
        if not ranked:
            return ""
        named = [f"{name}@{number}" for name, number in ranked[:MOST_NAMED]]
        more = f" and {len(ranked) - MOST_NAMED} more" if len(ranked) > MOST_NAMED else ""
        return f"workers played {', '.join(named)}{more}"

    @cached_property
    def _states(self) -> list[tuple[datetime, str]]:
        wanted = select(Event).where(
            Event.evaluation_id == self._evaluation.id, Event.kind == "evaluation"
        )
        found = self._session.scalars(wanted.order_by(Event.seq))
        return [(one.time, one.payload["state"]) for one in found]

    @cached_property
    def _others(self) -> list[_Held]:
        """Attempts at shards of other evaluations."""
        rows = self._session.execute(
            select(Policy.name, PolicyVersion.number, Attempt.leased, Attempt.ended)
            .select_from(Attempt)
            .join(Shard, Attempt.shard_id == Shard.id)
            .join(Evaluation, Shard.evaluation_id == Evaluation.id)
            .join(PolicyVersion, Evaluation.policy_version_id == PolicyVersion.id)
            .join(Policy, PolicyVersion.policy_id == Policy.id)
            .where(
                Evaluation.id != self._evaluation.id,
                Attempt.leased < self._until,
                or_(Attempt.ended.is_(None), Attempt.ended > self._evaluation.created),
            )
        )
        return [_Held(*row) for row in rows]


def _merged(gaps: Iterable[Gap]) -> list[Gap]:
    """The same stretches without overlaps, in order; ones that nearly touch are one."""
    found: list[Gap] = []
    for gap in sorted(gaps):
        if found and gap.start - found[-1].end < SHORTEST:
            found[-1] = Gap(found[-1].start, max(found[-1].end, gap.end))
        else:
            found.append(gap)
    return found
