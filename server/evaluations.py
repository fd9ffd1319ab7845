"""Evaluations as they stand: looked up, listed, with their progress; and new ones asked for."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from datetime import timedelta
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import Integer, Select, case, cast, func, select
from sqlalchemy.orm import Session, contains_eager

from hide_tasks import ALL_TASKS, SUITES, UnknownTask, load, suite
from hide_tasks.catalogue import suite_of
from hide_tasks.contract import EpisodeSpec
from hide_tasks.sources import sources_hash
from server import idempotency, lifecycle, policies, suites
from server.access import Principal, Scope
from server.models import Attempt, Episode, Evaluation, Event, Policy, PolicyVersion, Shard
from server.paging import after, page
from server.problems import invalid, not_found
from server.schemas.common import Page, RatePublic, Verdicts
from server.schemas.evaluations import AttemptPublic, EvaluationCreate, EvaluationPublic, Progress
from server.states import EpisodeState, EvaluationState, ShardState
from workers import fitness
from workers.protocol import CheckpointPolicy, RemotePolicy, ReplayPolicy
from workers.remote.maps import cameras_in
from workers.results import in_order

LATELY = 20  # episodes by which the pace is told


class Counts(NamedTuple):
    """Episodes of an evaluation, counted."""

    expected: int = 0
    final: int = 0
    running: int = 0
    success: int = 0
    exact: int = 0


@cache
def current_sources() -> dict[str, str]:
    """Per task, the hash of the code that would play it now."""
    return {task: sources_hash(task) for task in ALL_TASKS}


# --- asked for ---


def create(
    session: Session,
    wanted: EvaluationCreate,
    idempotency_key: str | None = None,
    *,
    owner: str | None = None,
) -> Evaluation:
    """A new evaluation, or the one that the same user's same key asked for before.

    Args:
        owner: id of the user who asks; None for the server itself.

    Raises:
        Problem: 422, no such policy, task or number of episodes; 422, the key was used for
            another request.
    """
    wanted = suites.resolved(wanted)
    asked = wanted.model_dump_json(exclude={"suite"})
    digest = hashlib.sha256(asked.encode()).hexdigest()
    if idempotency_key is not None:
        idempotency_key = idempotency.hashed(owner, idempotency_key)
        known = select(Evaluation).where(Evaluation.idempotency_key == idempotency_key)
        if there := session.scalar(known):
            return _same(there, digest)
    version, specs = planned(session, wanted)
    return lifecycle.create(
        session,
        version,
        specs,
        {task: current_sources()[task] for task in {spec.task for spec in specs}},
        rules=wanted.rules,
        priority=wanted.priority,
        recordings=wanted.recordings,
        idempotency_key=idempotency_key,
        request_digest=digest,
        owner_id=owner,
    )


def planned(session: Session, wanted: EvaluationCreate) -> tuple[PolicyVersion, list[EpisodeSpec]]:
    """Which version would play which episodes.

    Args:
        wanted: with its suite's tasks written out.

    Raises:
        Problem: 422, no such policy, task or number of episodes.
    """
    version = policies.find(session, wanted.policy)
    specs = _specs(wanted)
    _check_replay(session, version, specs)
    _check_policy(version, {spec.task for spec in specs})
    return version, specs


def require_priority(principal: Principal, priority: int) -> None:
    """Does nothing if whoever asks may have evaluations of this priority.

    Raises:
        Problem: 422, it is for maintainers.
    """
    if priority > 0 and not principal.may(Scope.MAINTAIN):
        raise invalid("priority", "is above 0, which is for maintainers")


def _same(evaluation: Evaluation, digest: str) -> Evaluation:
    if evaluation.request_digest != digest:
        message = "was used for another request; choose a new key"
        raise invalid("Idempotency-Key", message)
    return evaluation


def _specs(wanted: EvaluationCreate) -> list[EpisodeSpec]:
    if wanted.tasks is not None and wanted.category is not None:
        raise invalid("category", "excludes tasks; give one of them")
    most = suite.SPLITS[wanted.split]
    if wanted.episodes is not None and wanted.episodes > most:
        raise invalid("episodes", f"is {wanted.episodes}; {wanted.split} has {most} a task")
    try:
        named = in_order(set(wanted.tasks if wanted.tasks is not None else SUITES[suite.SUITE]))
        tasks = [name for name in named if wanted.category in (None, load(name).category)]
        of_suites = sorted({suite_of(name) for name in tasks})
    except UnknownTask as error:
        raise invalid("tasks", str(error)) from None
    if len(of_suites) > 1:
        raise invalid("tasks", f"are of suites {' and '.join(of_suites)}; an evaluation is of one")
    if not tasks:
        raise invalid("category", f"has no task yet: {wanted.category}")
    return [spec for task in tasks for spec in suite.episodes(task, wanted.split, wanted.episodes)]


def _check_policy(version: PolicyVersion, tasks: set[str]) -> None:
    """Refuses weights of another suite, and maps that name a camera which a task lacks."""
    name, reason = version.policy.name, ""
    if version.spec["kind"] == "checkpoint":
        trained_on = CheckpointPolicy.model_validate(version.spec).suite
        reason = fitness.is_of_another_suite(name, trained_on, tasks)
    elif version.spec["kind"] == "remote":
        seen = cameras_in(RemotePolicy.model_validate(version.spec).observation or {})
        reason = fitness.lacks_camera(name, seen, in_order(tasks))
    if reason:
        raise invalid("policy", reason)


def _check_replay(session: Session, version: PolicyVersion, specs: Sequence[EpisodeSpec]) -> None:
    """Refuses a replay of episodes that the evaluation it repeats does not have."""
    if version.spec["kind"] != "replay":
        return
    source = ReplayPolicy.model_validate(version.spec).evaluation
    there = set(
        session.execute(
            select(Episode.task, Episode.split, Episode.index).where(
                Episode.evaluation_id == source, Episode.state == EpisodeState.FINAL
            )
        )
    )
    for spec in specs:
        if (spec.task, spec.split, spec.index) not in there:
            raise invalid("policy", f"{source} has no final {spec.name} to replay")


# --- looked up ---


def row(session: Session, id: str) -> Evaluation:
    """The evaluation with this id.

    Raises:
        Problem: 404, there is none.
    """
    if found := session.get(Evaluation, id):
        return found
    raise not_found("evaluation", id)


def get(session: Session, id: str) -> EvaluationPublic:
    """The evaluation with this id, as it stands.

    Raises:
        Problem: 404, there is none.
    """
    return public(session, row(session, id))


def public(session: Session, evaluation: Evaluation) -> EvaluationPublic:
    """An evaluation as the API gives it out."""
    return public_all(session, [evaluation])[0]


def listed(
    session: Session,
    *,
    state: EvaluationState | None = None,
    policy: str | None = None,
    limit: int = 50,
    cursor: str | None = None,
) -> Page[EvaluationPublic]:
    """Evaluations, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(Evaluation).order_by(Evaluation.id.desc()).limit(limit + 1)
    if state is not None:
        wanted = wanted.where(Evaluation.state == state)
    if policy is not None:
        wanted = wanted.join(PolicyVersion).join(Policy).where(Policy.name == policy)
    if place := after(cursor, [str]):
        wanted = wanted.where(Evaluation.id < place[0])
    rows = session.scalars(wanted).all()
    shown = {one.id: one for one in public_all(session, rows[:limit])}
    return page(rows, limit, lambda one: [one.id], lambda one: shown[one.id])


def attempts(session: Session, id: str) -> list[AttemptPublic]:
    """Every attempt at an evaluation's shards, the newest first."""
    return [_attempt(one) for one in session.scalars(_attempts(row(session, id).id))]


def attempts_listed(
    session: Session, id: str, *, limit: int = 50, cursor: str | None = None
) -> Page[AttemptPublic]:
    """Attempts at an evaluation's shards, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = _attempts(row(session, id).id).limit(limit + 1)
    if place := after(cursor, [str]):
        wanted = wanted.where(Attempt.id < place[0])
    return page(session.scalars(wanted).all(), limit, lambda one: [one.id], _attempt)


def _attempts(evaluation: str) -> Select[Attempt]:
    wanted = select(Attempt).join(Attempt.shard).where(Shard.evaluation_id == evaluation)
    wanted = wanted.options(contains_eager(Attempt.shard))
    return wanted.order_by(Attempt.id.desc())


def _attempt(one: Attempt) -> AttemptPublic:
    same = ("id", "fence", "state", "reason", "leased", "ended")
    fields = {name: getattr(one, name) for name in same}
    return AttemptPublic.model_validate(fields | {"task": one.shard.task})


def _last_events(session: Session, evaluations: Iterable[str]) -> dict[str, int]:
    """The number of the newest event of each."""
    newest = select(Event.evaluation_id, func.max(Event.seq))
    wanted = newest.where(Event.evaluation_id.in_(list(evaluations)))
    found = session.execute(wanted.group_by(Event.evaluation_id))
    return {one.evaluation_id: one[1] for one in found}


# --- counted ---


def counts(session: Session, evaluations: Iterable[str]) -> dict[str, Counts]:
    """Episodes by evaluation."""
    found = session.execute(
        select(
            Episode.evaluation_id,
            func.count(),
            func.sum(case((Episode.state == EpisodeState.FINAL, 1), else_=0)),
            func.sum(case((Episode.state == EpisodeState.RUNNING, 1), else_=0)),
            func.coalesce(func.sum(cast(Episode.success, Integer)), 0),
            func.coalesce(func.sum(cast(Episode.exact, Integer)), 0),
        )
        .where(Episode.evaluation_id.in_(list(evaluations)))
        .group_by(Episode.evaluation_id)
    )
    return {id: Counts(*numbers) for id, *numbers in found}


def counts_by_task(session: Session, evaluation: str) -> dict[str, Counts]:
    """The final episodes of one evaluation by task."""
    found = session.execute(
        select(
            Episode.task,
            func.count(),
            func.sum(cast(Episode.success, Integer)),
            func.sum(cast(Episode.exact, Integer)),
        )
        .where(Episode.evaluation_id == evaluation, Episode.state == EpisodeState.FINAL)
        .group_by(Episode.task)
    )
    return {task: Counts(number, number, 0, *both) for task, number, *both in found}


def verdicts(counted: Counts) -> Verdicts:
    """Both rates over the final episodes."""
    return Verdicts(
        success=RatePublic.of(counted.success, counted.final),
        exact=RatePublic.of(counted.exact, counted.final),
    )


def progress(session: Session, evaluation: Evaluation, counted: Counts) -> Progress:
    """How far it is, how fast it goes lately, and how long it will take."""
    pace = _per_minute(session, evaluation) if evaluation.state == "running" else None
    left = counted.expected - counted.final
    return Progress(
        expected=counted.expected,
        final=counted.final,
        running=counted.running,
        per_minute=pace,
        seconds_left=60 * left / pace if pace else None,
    )


def _per_minute(session: Session, evaluation: Evaluation) -> float | None:
    newest = (
        select(Episode.committed)
        .where(Episode.evaluation_id == evaluation.id, Episode.committed.is_not(None))
        .order_by(Episode.committed.desc())
        .limit(LATELY)
    )
    times = [time for time in session.scalars(newest) if time]
    if len(times) < 2 or times[0] - times[-1] < timedelta(milliseconds=1):
        return None
    return 60 * (len(times) - 1) / (times[0] - times[-1]).total_seconds()


def public_all(session: Session, rows: Sequence[Evaluation]) -> list[EvaluationPublic]:
    """Evaluations as the API gives them out, in the order given."""
    ids = [one.id for one in rows]
    newest = _last_events(session, ids)  # first: what happens from now on may be in here too
    counted, closed = counts(session, ids), _sandboxes(session, ids)
    return [
        _public(
            session,
            one,
            counted.get(one.id, Counts()),
            {"sandboxes": closed.get(one.id, []), "last_event": newest.get(one.id, 0)},
        )
        for one in rows
    ]


def _public(
    session: Session, one: Evaluation, counted: Counts, others: Mapping[str, Any]
) -> EvaluationPublic:
    version = one.policy_version
    fields: dict[str, Any] = {
        "policy": version.policy.name,
        "version": version.number,
        "policy_version": version.id,
        "reference": version.reference,
        "suite": f"{one.suite} {one.suite_version}",
        "covers": suites.covers(one),
        "reason": one.reason or _why_it_waits(session, one),
        "progress": progress(session, one, counted),
        "verdicts": verdicts(counted),
        "owner": one.owner and one.owner.name,
    }
    same = "id state desired split rules tasks episodes priority recordings created started ended"
    fields |= {name: getattr(one, name) for name in same.split()}
    return EvaluationPublic.model_validate({**fields, **others})


def _sandboxes(session: Session, evaluations: Iterable[str]) -> dict[str, list[str]]:
    """What was around the policies' processes; nothing where there was none, or none is final."""
    played = select(Episode.evaluation_id, Episode.sandbox).where(
        Episode.evaluation_id.in_(list(evaluations)), Episode.sandbox.is_not(None)
    )
    found: dict[str, list[str]] = {}
    for evaluation, sandbox in session.execute(played.distinct().order_by(Episode.sandbox)):
        found.setdefault(evaluation, []).append(str(sandbox))
    return found


def _why_it_waits(session: Session, one: Evaluation) -> str | None:
    if one.desired == "cancelled" and one.state == EvaluationState.RUNNING:
        return "stopping what runs"
    if one.state != EvaluationState.QUEUED:
        return None
    before = session.scalar(
        select(func.count(Shard.id))
        .join(Evaluation)
        .where(
            Shard.state.in_([ShardState.PENDING, ShardState.LEASED]),
            Evaluation.id != one.id,
            (Evaluation.priority > one.priority)
            | ((Evaluation.priority == one.priority) & (Evaluation.id < one.id)),
        )
    )
    return (
        f"waits for a worker; {before} shard{' is' if before == 1 else 's are'} before it"
        if before
        else ("waits for a worker")
    )
