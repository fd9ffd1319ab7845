"""What an evaluation would cost before it is asked for: episodes, minutes, and what goes first.

Its pace is the wall time of episodes that this server has measured: of the policy itself, else of
policies of its kind, else of any; where a task was never played, a time is assumed and said so.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from hide_tasks import load
from hide_tasks.contract import EpisodeSpec
from server import evaluations, quotas, suites, waiting
from server.access import Principal
from server.hub import Hub
from server.models import Episode, Evaluation, PolicyVersion, User
from server.schemas.evaluations import EstimatePublic, EvaluationCreate
from server.schemas.people import Quotas
from server.states import Desired, EpisodeState, EvaluationState
from workers.protocol import SHARD_SIZE

Basis = Literal["policy", "kind", "others", "assumed"]
ASSUMED = 0.15  # s a decision of the budget: what the built-in policies take on two cores
RECENT = 20  # evaluations whose episodes tell a pace
WORDS: Mapping[Basis, str] = {
    "policy": "measured: this policy's own episodes on this server",
    "kind": "measured: episodes of policies of its kind on this server",
    "others": "measured: episodes of other policies on this server; this one may be slower",
    "assumed": f"assumed for tasks never played here: {ASSUMED:g} s for each decision of the "
    "budget",
}


class Load(NamedTuple):
    """An evaluation that waits or is played, and what is left of it."""

    priority: int
    shards: int  # that wait
    seconds: float  # of one worker


def of(
    session: Session, hub: Hub, principal: Principal, wanted: EvaluationCreate
) -> EstimatePublic:
    """What an evaluation would cost.

    Raises:
        Problem: 422, it would be refused as wrong.
    """
    evaluations.require_priority(principal, wanted.priority)
    version, specs = evaluations.planned(session, suites.resolved(wanted))
    counted = Counter(spec.task for spec in specs)
    covers = suites.covering(specs[0].split, counted, len(specs) // len(counted))
    seconds, basis = _own_seconds(session, version, counted)
    slots = _slots(hub, version)
    ahead = [one for one in _loads(session) if one.priority >= wanted.priority]
    later = sum(_delay(one, wanted.priority, seconds) for one in ahead)
    used, refused = _quotas(session, hub, principal, specs)
    return EstimatePublic(
        policy=version.policy.name,
        version=version.number,
        tasks=list(counted),
        episodes=len(specs),
        shards=sum(-(-number // SHARD_SIZE) for number in counted.values()),
        covers=covers,
        ranked=covers in suites.WHOLE and wanted.rules == "hide",
        workers=slots,
        per_minute=60 * len(specs) * slots / seconds if slots else None,
        seconds=seconds / slots if slots else None,
        basis=basis,
        basis_detail=WORDS[basis],
        evaluations_before=sum(one.shards > 0 for one in ahead),
        shards_before=sum(one.shards for one in ahead),
        seconds_before=later / slots if slots else None,
        quotas=used,
        refused=refused,
    )


def _slots(hub: Hub, version: PolicyVersion) -> int:
    """Shards that are played for it at a time; the server of a remote policy may take fewer."""
    slots = hub.reconciler.slots() if hub.reconciler else 0
    return min(slots, version.spec.get("concurrency") or slots)


def _delay(one: Load, priority: int, own: float) -> float:
    """By how much another makes it later: those of its priority take turns with it."""
    return one.seconds if one.priority > priority else min(one.seconds, own)


# --- the pace ---


def _own_seconds(
    session: Session, version: PolicyVersion, counted: Mapping[str, int]
) -> tuple[float, Basis]:
    """Of one worker for so many episodes of each task, and what that is from."""
    paces = _paces(session, version)
    order: list[Basis] = ["policy", "kind", "others", "assumed"]
    found = {task: paces.get(task) or (_assumed(task), "assumed") for task in counted}
    weakest = max((basis for _, basis in found.values()), key=order.index)
    return sum(number * found[task][0] for task, number in counted.items()), weakest


def _paces(session: Session, version: PolicyVersion) -> dict[str, tuple[float, Basis]]:
    """Seconds of an episode of each task that was ever played."""
    kind = PolicyVersion.spec["kind"].as_string() == version.spec["kind"]
    sources: list[tuple[Basis, Any]] = [
        ("others", PolicyVersion.id != version.id),
        ("kind", kind & PolicyVersion.reference.is_(version.reference)),
        ("policy", PolicyVersion.id == version.id),
    ]
    found: dict[str, tuple[float, Basis]] = {}
    for basis, whose in sources:
        found |= {task: (pace, basis) for task, pace in _measured(session, whose).items()}
    return found


def _measured(session: Session, whose: Any) -> dict[str, float]:
    """The mean wall time of an episode by task, over the newest evaluations of some policies."""
    newest = (
        select(Evaluation.id)
        .join(PolicyVersion, Evaluation.policy_version_id == PolicyVersion.id)
        .where(whose, Evaluation.started.is_not(None))
        .order_by(Evaluation.id.desc())
        .limit(RECENT)
    )
    total = func.avg(Episode.timing["total"].as_float())
    rows = session.execute(
        select(Episode.task, total)
        .where(Episode.evaluation_id.in_(newest), Episode.state == EpisodeState.FINAL)
        .group_by(Episode.task)
    )
    return {task: float(pace) for task, pace in rows if pace}


def _assumed(task: str) -> float:
    return ASSUMED * load(task).budget()


# --- what goes first ---


def _loads(session: Session) -> list[Load]:
    """Every evaluation that waits or is played, with what is left of it."""
    left: dict[str, Counter[str]] = defaultdict(Counter)
    priorities: dict[str, int] = {}
    pending = {one.evaluation.id: one.pending for one in waiting.evaluations(session)}
    rows = session.execute(
        select(Evaluation.id, Evaluation.priority, Episode.task, func.count())
        .join(Episode, Episode.evaluation_id == Evaluation.id)
        .where(
            Evaluation.state.in_([EvaluationState.QUEUED, EvaluationState.RUNNING]),
            Evaluation.desired == Desired.FINISHED,
            Episode.state != EpisodeState.FINAL,
        )
        .group_by(Evaluation.id, Evaluation.priority, Episode.task)
    )
    for id, priority, task, number in rows:
        left[id][task], priorities[id] = number, priority
    paces = _measured(session, PolicyVersion.id.is_not(None)) if left else {}
    return [
        Load(priorities[id], pending.get(id, 0), _seconds(tasks, paces))
        for id, tasks in left.items()
    ]


def _seconds(tasks: Mapping[str, int], paces: Mapping[str, float]) -> float:
    return sum(number * (paces.get(task) or _assumed(task)) for task, number in tasks.items())


# --- what may be asked for ---


def _quotas(
    session: Session, hub: Hub, principal: Principal, specs: Sequence[EpisodeSpec]
) -> tuple[Quotas, str | None]:
    bound = quotas.is_bound(principal, hub.settings)
    found = quotas.of(session, session.get_one(User, principal.user), hub.settings, bound=bound)
    scored = quotas.is_scored(specs[0].split, {spec.task for spec in specs}, len(specs))
    for quota, what, counts in (
        (found.attempts, "evaluations in 24 hours", True),
        (found.scored, "scored evaluations in 30 days", scored),
    ):
        if counts and quota.limit is not None and quota.used >= quota.limit:
            return found, f"Your quota of {quota.limit} {what} is used up."
    return found, None
