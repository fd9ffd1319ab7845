"""The life of an evaluation, in the order it happens; every function is one transaction's work.

create ─► Evaluation queued ─► Shards pending ─► Episodes pending
lease ─► Attempt open with a fence, Shard leased                      Evaluation running
begin ─► Episode running
commit ─► Episode final      (the current fence only; the same digest twice is fine)
end_attempt ─► Attempt done, Shard done ─► the last one?              Evaluation completed
           └─► Attempt lost, Shard pending; after 3 faults failed ─► Evaluation incomplete
cancel ─► Shards cancelled, open attempts stopped by the reconciler   Evaluation cancelled
resume ─► failed Shards pending                                       Evaluation queued
"""

import hashlib
import logging
import secrets
from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import ColumnElement, func, or_, select, update
from sqlalchemy.orm import Session, aliased

from hide_tasks import load
from hide_tasks.contract import EpisodeSpec
from hide_tasks.machine import fingerprint
from server.models import (
    Attempt,
    Episode,
    Evaluation,
    Event,
    PolicyVersion,
    Shard,
    new_id,
    now,
)
from server.problems import Problem
from server.states import (
    AttemptState,
    Desired,
    EpisodeState,
    EvaluationState,
    ShardState,
)
from workers.protocol import EPISODE_FINAL, SHARD_SIZE

logger = logging.getLogger(__name__)
FAULTS = 3  # attempts of a shard that may be lost before it fails


def emit(session: Session, evaluation: str, kind: str, **payload: Any) -> None:
    """Adds to what followers of an evaluation are told."""
    facts = {"evaluation": evaluation, "event": kind, "facts": payload}
    logger.info("An evaluation goes on", extra=facts)
    session.add(Event(evaluation_id=evaluation, kind=kind, payload=payload))


# --- create ---


def create(
    session: Session,
    version: PolicyVersion,
    specs: Sequence[EpisodeSpec],
    sources: Mapping[str, str],
    **settings: Any,
) -> Evaluation:
    """A queued evaluation with all its shards and episodes.

    Args:
        specs: the episodes, of one suite and split, task by task, in order.
        sources: per task, the hash of the code that plays it.
        settings: rules, priority, recordings, idempotency_key, request_digest.
    """
    tasks = list(dict.fromkeys(spec.task for spec in specs))
    evaluation = Evaluation(
        id=new_id("ev"),
        policy_version=version,
        suite=specs[0].suite,
        suite_version=specs[0].version,
        split=specs[0].split,
        tasks=tasks,
        episodes=len(specs) // len(tasks),
        sources=dict(sources),
        machine=fingerprint(),
        **settings,
    )
    session.add(evaluation)
    session.flush()
    for task in tasks:
        _add_shards(session, evaluation, [spec for spec in specs if spec.task == task])
    emit(session, evaluation.id, "evaluation", state=EvaluationState.QUEUED, reason=None)
    return evaluation


def _add_shards(session: Session, evaluation: Evaluation, specs: Sequence[EpisodeSpec]) -> None:
    for first in range(0, len(specs), SHARD_SIZE):
        part = specs[first : first + SHARD_SIZE]
        shard = Shard(
            id=new_id("sh"),
            evaluation_id=evaluation.id,
            task=part[0].task,
            first_index=part[0].index,
        )
        session.add(shard)
        session.flush()
        session.add_all(_episode(evaluation, shard, spec) for spec in part)


def _episode(evaluation: Evaluation, shard: Shard, spec: EpisodeSpec) -> Episode:
    return Episode(
        id=new_id("ep"),
        evaluation_id=evaluation.id,
        shard_id=shard.id,
        category=str(load(spec.task).category),
        **spec.model_dump(include={"task", "split", "index", "variation", "draw"}),
    )


def spec_of(episode: Episode) -> EpisodeSpec:
    """What the episode's row says is to be played."""
    return EpisodeSpec(
        suite=episode.evaluation.suite,
        version=episode.evaluation.suite_version,
        task=episode.task,
        split=episode.split,
        index=episode.index,
        variation=episode.variation,
        draw=episode.draw,
    )


# --- lease ---


def next_shard(session: Session) -> Shard | None:
    """The shard to hand out next: by priority, then fair share, then age.

    Within an evaluation the tasks go side by side, so that an early look says something of each.
    The server of a remote policy is not asked for more episodes at a time than it takes.
    """
    leased = (
        select(func.count())
        .where(Shard.evaluation_id == Evaluation.id, Shard.state == ShardState.LEASED)
        .correlate(Evaluation)
        .scalar_subquery()
    )
    return session.scalar(
        select(Shard)
        .join(Evaluation, Shard.evaluation_id == Evaluation.id)
        .join(PolicyVersion, Evaluation.policy_version_id == PolicyVersion.id)
        .where(Shard.state == ShardState.PENDING, Evaluation.desired == Desired.FINISHED)
        .where(_has_room())
        .order_by(Evaluation.priority.desc(), leased, Evaluation.id, Shard.first_index, Shard.task)
        .limit(1)
    )


def _has_room() -> ColumnElement[bool]:
    """True unless the policy is remote and its server plays all that it can."""
    shard, evaluation, version = aliased(Shard), aliased(Evaluation), aliased(PolicyVersion)
    url = PolicyVersion.spec["url"].as_string()
    playing = (
        select(func.count())
        .select_from(shard)
        .join(evaluation, shard.evaluation_id == evaluation.id)
        .join(version, evaluation.policy_version_id == version.id)
        .where(shard.state == ShardState.LEASED, version.spec["url"].as_string() == url)
        .correlate(PolicyVersion)
        .scalar_subquery()
    )
    return or_(url.is_(None), playing < PolicyVersion.spec["concurrency"].as_integer())


def lease(session: Session, shard: Shard, *, engine: str) -> tuple[Attempt, str]:
    """A new attempt with the next fence, and its token, which is kept nowhere."""
    token = secrets.token_urlsafe(32)
    shard.fence += 1
    shard.state = ShardState.LEASED
    attempt = Attempt(
        id=new_id("at"),
        shard_id=shard.id,
        fence=shard.fence,
        engine=engine,
        token_hash=hash_token(token),
    )
    session.add(attempt)
    evaluation = shard.evaluation
    if evaluation.state == EvaluationState.QUEUED:
        evaluation.started = evaluation.started or now()
        _move(session, evaluation, EvaluationState.RUNNING)
    session.flush()
    return attempt, token


def fail_shard(session: Session, shard: Shard, reason: str) -> None:
    """A shard that waits cannot be played at all; its evaluation may be resumed later."""
    shard.state, shard.reason = ShardState.FAILED, reason
    session.flush()
    settle(session, shard.evaluation)


def hash_token(token: str) -> str:
    """What the ledger keeps of a token."""
    return hashlib.sha256(token.encode()).hexdigest()


def open_episodes(shard: Shard) -> list[Episode]:
    """The episodes of a shard that are left to play."""
    return [episode for episode in shard.episodes if episode.state != EpisodeState.FINAL]


# --- play ---


def require_open(attempt: Attempt) -> None:
    """Refuses what a superseded or ended attempt wants.

    Raises:
        Problem: 409, the attempt is not the current one.
    """
    if attempt.state != AttemptState.OPEN:
        raise Problem(
            409,
            "stale_attempt",
            f"Attempt {attempt.id} has ended ({attempt.state}); only an open attempt may report.",
        )


def begin(session: Session, attempt: Attempt, episode: Episode) -> None:
    """The attempt starts to play an episode.

    Raises:
        Problem: 409, the attempt is stale or the episode is final.
    """
    require_open(attempt)
    if episode.state == EpisodeState.FINAL:
        raise Problem(409, EPISODE_FINAL, f"Episode {episode.id} is final.")
    episode.state, episode.fence, episode.started = EpisodeState.RUNNING, attempt.fence, now()
    tell_episode(session, episode)


def put_back(session: Session, attempt: Attempt, episode: Episode, reason: str) -> None:
    """An episode could not be played, through no fault of a policy; another attempt tries it.

    Raises:
        Problem: 409, the attempt is stale.
    """
    require_open(attempt)
    if episode.state == EpisodeState.RUNNING and episode.fence == attempt.fence:
        episode.state = EpisodeState.PENDING
        tell_episode(session, episode)
    emit(session, episode.evaluation_id, "fault", id=episode.id, reason=reason)


def tell_episode(session: Session, episode: Episode) -> None:
    """Tells followers where an episode stands."""
    emit(
        session,
        episode.evaluation_id,
        "episode",
        id=episode.id,
        task=episode.task,
        index=episode.index,
        state=episode.state,
        success=episode.success,
        exact=episode.exact,
        failure=episode.failure,
    )


# --- end ---


def end_attempt(
    session: Session, attempt: Attempt, reason: str | None, *, fault: bool = True
) -> None:
    """An attempt is over, whatever became of it; does nothing if that is known.

    Args:
        reason: why the engine says it ended; None if it came to its end by itself.
        fault: whether it counts against the shard; a stop of the server does not.
    """
    if attempt.state != AttemptState.OPEN:
        return
    shard = attempt.shard
    left = _take_back(session, shard)
    attempt.ended = now()
    if not left:
        attempt.state, shard.state, shard.reason = AttemptState.DONE, ShardState.DONE, None
    elif shard.evaluation.desired == Desired.CANCELLED:
        attempt.state = AttemptState.CANCELLED
        shard.state = ShardState.CANCELLED
    else:
        attempt.state = AttemptState.LOST
        attempt.reason = reason or f"ended with {left} episodes left to play"
        shard.reason = attempt.reason
        shard.faults += fault
        shard.state = ShardState.FAILED if shard.faults >= FAULTS else ShardState.PENDING
    emit(
        session,
        shard.evaluation_id,
        "attempt",
        task=shard.task,
        fence=attempt.fence,
        state=attempt.state,
        reason=attempt.reason,
    )
    session.flush()
    settle(session, shard.evaluation)


def _take_back(session: Session, shard: Shard) -> int:
    """Puts the running episodes of a shard back; how many are left to play."""
    left = open_episodes(shard)
    for episode in left:
        if episode.state == EpisodeState.RUNNING:
            episode.state = EpisodeState.PENDING
            tell_episode(session, episode)
    return len(left)


def settle(session: Session, evaluation: Evaluation) -> None:
    """Ends an evaluation of which no shard waits or runs any more."""
    states = set(
        session.scalars(select(Shard.state).where(Shard.evaluation_id == evaluation.id).distinct())
    )
    if states & {ShardState.PENDING, ShardState.LEASED}:
        return
    if states == {ShardState.DONE}:
        _end(session, evaluation, EvaluationState.COMPLETED, None)
    elif evaluation.desired == Desired.CANCELLED:
        _end(session, evaluation, EvaluationState.CANCELLED, None)
    else:
        _end(session, evaluation, EvaluationState.INCOMPLETE, _why_incomplete(session, evaluation))


def _why_incomplete(session: Session, evaluation: Evaluation) -> str:
    failed = select(Shard).where(
        Shard.evaluation_id == evaluation.id, Shard.state == ShardState.FAILED
    )
    shards = session.scalars(failed.order_by(Shard.task, Shard.first_index)).all()
    first = shards[0]
    more = f" (and {len(shards) - 1} more shards)" if len(shards) > 1 else ""
    return f"{first.task} from episode {first.first_index}: {first.reason}{more}"


def _end(
    session: Session, evaluation: Evaluation, state: EvaluationState, reason: str | None
) -> None:
    if evaluation.state == state:
        return
    evaluation.ended = now()
    evaluation.reason = reason
    _move(session, evaluation, state)


def _move(session: Session, evaluation: Evaluation, state: EvaluationState) -> None:
    evaluation.state = state
    emit(session, evaluation.id, "evaluation", state=state, reason=evaluation.reason)


# --- what users ask for ---


def cancel(session: Session, evaluation: Evaluation) -> None:
    """Wants an evaluation stopped; what is final stays. Asking twice is fine.

    Raises:
        Problem: 409, it is completed.
    """
    if evaluation.state == EvaluationState.COMPLETED:
        raise Problem(409, "completed", f"Evaluation {evaluation.id} is completed already.")
    evaluation.desired = Desired.CANCELLED
    session.execute(
        update(Shard)
        .where(
            Shard.evaluation_id == evaluation.id,
            Shard.state.in_([ShardState.PENDING, ShardState.FAILED]),
        )
        .values(state=ShardState.CANCELLED)
    )
    settle(session, evaluation)


def resume(session: Session, evaluation: Evaluation, sources: Mapping[str, str]) -> None:
    """Plays what is missing of an incomplete evaluation; final episodes stay as they are.

    Raises:
        Problem: 409, it is not incomplete, or its tasks have other sources by now.
    """
    if evaluation.state != EvaluationState.INCOMPLETE:
        raise Problem(
            409,
            "not_incomplete",
            f"Evaluation {evaluation.id} is {evaluation.state}; only an incomplete one resumes.",
        )
    if changed := changed_tasks(evaluation, sources):
        raise Problem(409, "sources_changed", _changed(changed))
    session.execute(
        update(Shard)
        .where(Shard.evaluation_id == evaluation.id, Shard.state == ShardState.FAILED)
        .values(state=ShardState.PENDING, faults=0)
    )
    evaluation.ended = evaluation.reason = None
    _move(session, evaluation, EvaluationState.QUEUED)


def changed_tasks(evaluation: Evaluation, sources: Mapping[str, str]) -> list[str]:
    """The tasks that would be played by other code than before."""
    return [task for task, was in evaluation.sources.items() if sources.get(task) != was]


def _changed(tasks: Sequence[str]) -> str:
    return f"The sources of {', '.join(tasks)} have changed since it began; start another."


# --- after a restart ---


def recover(session: Session, sources: Mapping[str, str]) -> int:
    """Takes back what a stopped server had handed out; how many attempts that were.

    What other sources of the tasks began is not continued: one evaluation, one code.
    """
    attempts = session.scalars(select(Attempt).where(Attempt.state == AttemptState.OPEN)).all()
    for attempt in attempts:
        end_attempt(session, attempt, "the server stopped", fault=False)
    unfinished = Evaluation.state.in_([EvaluationState.QUEUED, EvaluationState.RUNNING])
    for evaluation in session.scalars(select(Evaluation).where(unfinished)).all():
        if changed := changed_tasks(evaluation, sources):
            _give_up(session, evaluation, _changed(changed))
    return len(attempts)


def _give_up(session: Session, evaluation: Evaluation, reason: str) -> None:
    session.execute(
        update(Shard)
        .where(Shard.evaluation_id == evaluation.id, Shard.state == ShardState.PENDING)
        .values(state=ShardState.FAILED, reason=reason)
    )
    settle(session, evaluation)
