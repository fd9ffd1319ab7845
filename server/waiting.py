"""What waits to be played, in its order and with the reason, and what is being played."""

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

from sqlalchemy import ColumnElement, Integer, cast, exists, func, select
from sqlalchemy.orm import Session

from server.hub import Hub
from server.models import Attempt, Episode, Evaluation, PolicyVersion, Shard
from server.schemas.queue import Queue, QueueItem, QueueReason, WorkerPublic, Workers
from server.states import AttemptState, Desired, EpisodeState, ShardState

Why = tuple[QueueReason, str]


class Waiting(NamedTuple):
    """An evaluation and its shards, counted."""

    evaluation: Evaluation
    pending: int
    leased: int


def queue(session: Session, hub: Hub, *, limit: int = 50) -> Queue:
    """Evaluations of which shards wait, in the order in which their next ones are handed out."""
    found = evaluations(session)
    busy, stopped = _busy_servers(session), _stopped(hub)
    before = [0, *accumulate(one.pending for one in found)]
    items = [
        _item(place, one, before[place], stopped or _reason(busy, one, before[place]))
        for place, one in enumerate(found[:limit])
    ]
    return Queue(evaluations=len(found), shards=before[-1], items=items)


def place(session: Session, hub: Hub, evaluation: str) -> QueueItem | None:
    """Where an evaluation stands in the queue; None if none of its shards waits."""
    items = queue(session, hub, limit=2**31).items
    return next((item for item in items if item.evaluation == evaluation), None)


def evaluations(session: Session) -> list[Waiting]:
    """Those of which shards wait, in the order of `lifecycle.next_shard`."""

    def count(state: ShardState) -> ColumnElement[int]:
        return func.sum(cast(Shard.state == state, Integer))

    pending, leased = count(ShardState.PENDING), count(ShardState.LEASED)
    counted = (
        select(Shard.evaluation_id, pending.label("pending"), leased.label("leased"))
        .where(Shard.state.in_([ShardState.PENDING, ShardState.LEASED]))
        .group_by(Shard.evaluation_id)
        .subquery()
    )
    rows = session.execute(
        select(Evaluation, counted.c.pending, counted.c.leased)
        .join(counted, counted.c.evaluation_id == Evaluation.id)
        .where(counted.c.pending > 0, Evaluation.desired == Desired.FINISHED)
        .order_by(Evaluation.priority.desc(), counted.c.leased, Evaluation.id)
    )
    return [Waiting(*row) for row in rows]


class HandedOut(NamedTuple):
    """How many shards of an evaluation are handed out."""

    begun: int  # a worker plays their episodes
    ahead: int  # that are to be begun by the next worker that is free


def handed_out(session: Session, evaluation: str) -> HandedOut:
    """The shards of an evaluation that do not wait and are not done."""
    begun = exists().where(Episode.shard_id == Shard.id, Episode.fence == Shard.fence)
    leased = select(begun).where(
        Shard.evaluation_id == evaluation, Shard.state == ShardState.LEASED
    )
    found = list(session.scalars(leased))
    return HandedOut(sum(found), len(found) - sum(found))


def _busy_servers(session: Session) -> dict[str, int]:
    """How many shards the servers of remote policies play now, by their URL."""
    url = PolicyVersion.spec["url"].as_string()
    rows = session.execute(
        select(url, func.count())
        .select_from(Shard)
        .join(Evaluation, Shard.evaluation_id == Evaluation.id)
        .join(PolicyVersion, Evaluation.policy_version_id == PolicyVersion.id)
        .where(Shard.state == ShardState.LEASED, url.is_not(None))
        .group_by(url)
    )
    return {str(name): number for name, number in rows}


def _item(place: int, one: Waiting, before: int, why: Why) -> QueueItem:
    evaluation, version = one.evaluation, one.evaluation.policy_version
    return QueueItem(
        position=place + 1,
        evaluation=evaluation.id,
        policy=version.policy.name,
        version=version.number,
        owner=evaluation.owner and evaluation.owner.name,
        priority=evaluation.priority,
        state=evaluation.state,
        waiting=one.pending,
        running=one.leased,
        before=before,
        reason=why[0],
        detail=why[1],
    )


def _stopped(hub: Hub) -> Why | None:
    """Why nothing at all is handed out."""
    if hub.engine is None:
        return QueueReason.NO_WORKERS, "This server was started without workers."
    if not hub.has_room():
        return QueueReason.DISK_FULL, "The server's disk is full; nothing is handed out."
    return None


def _counted(number: int, what: str) -> str:
    """ "1 shard is", "2 shards are"."""
    return f"{number} {what} is" if number == 1 else f"{number} {what}s are"


def _reason(busy: dict[str, int], one: Waiting, before: int) -> Why:
    spec = one.evaluation.policy_version.spec
    playing = busy.get(str(spec.get("url")), 0)
    if spec.get("url") and playing >= (spec.get("concurrency") or 1):
        plays = "1 shard" if playing == 1 else f"{playing} shards"
        return QueueReason.POLICY_BUSY, f"Its policy's server plays {plays}, its most."
    if before:
        return QueueReason.OTHERS_FIRST, f"{_counted(before, 'shard')} handed out before."
    return QueueReason.WORKERS_BUSY, "It is next, as soon as a worker is free."


# --- what is played ---


def workers(session: Session, hub: Hub) -> Workers:
    """What is handed out, and how far each is."""
    wanted = select(Attempt).where(Attempt.state == AttemptState.OPEN)
    wanted = wanted.order_by(Attempt.leased, Attempt.id)
    items = [_worker(attempt) for attempt in session.scalars(wanted)]
    playing = sum(one.doing != "begins" for one in items)
    slots = hub.reconciler.slots() if hub.reconciler else 0
    return Workers(slots=slots, playing=playing, items=items)


def _worker(attempt: Attempt) -> WorkerPublic:
    shard, evaluation = attempt.shard, attempt.shard.evaluation
    version = evaluation.policy_version
    own = [one for one in shard.episodes if one.fence == attempt.fence]
    now = next((one for one in own if one.state == EpisodeState.RUNNING), None)
    return WorkerPublic(
        attempt=attempt.id,
        engine=attempt.engine,
        doing="plays" if now else "between" if own else "begins",
        evaluation=evaluation.id,
        policy=version.policy.name,
        version=version.number,
        task=shard.task,
        fence=attempt.fence,
        since=attempt.leased,
        episode=now and now.id,
        index=now.index if now else None,
        episode_since=now and now.started,
        final=_final(shard.episodes),
        episodes=len(shard.episodes),
    )


def _final(episodes: Sequence[Episode]) -> int:
    return sum(one.state == EpisodeState.FINAL for one in episodes)
