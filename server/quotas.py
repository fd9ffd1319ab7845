"""How much a user may ask for: evaluations in a day, scored ones in a month, bytes of checkpoints.

Nothing is counted up: what was used is asked of the ledger, so it cannot drift. An evaluation
that infrastructure left incomplete, or that was cancelled before it began, is given back.
"""

from collections.abc import Iterable
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, Select, and_, func, select
from sqlalchemy.orm import Session

from hide_tasks import suite
from hide_tasks.contract import Split
from server import suites
from server.access import Principal, Scope
from server.models import Evaluation, Policy, PolicyVersion, User, now
from server.problems import Problem
from server.schemas.people import Quota, Quotas
from server.settings import Settings
from server.states import EvaluationState

DAY, MONTH = timedelta(hours=24), timedelta(days=30)
SCORED_SPLIT: Split = "test"


def of(session: Session, user: User, settings: Settings, *, bound: bool) -> Quotas:
    """What a user has used, and may use at most; without bounds for maintainers and local mode."""

    def limit(own: int | None, general: int | None) -> int | None:
        return (general if own is None else own) if bound else None

    return Quotas(
        attempts=Quota(
            used=len(_attempts(session, user.id)),
            limit=limit(user.attempts, settings.quota_attempts),
        ),
        scored=Quota(
            used=len(_scored(session, user.id)), limit=limit(user.scored, settings.quota_scored)
        ),
        storage=Quota(
            used=stored(session, user.id), limit=limit(user.storage, settings.quota_storage)
        ),
    )


def is_bound(principal: Principal, settings: Settings) -> bool:
    """True if quotas hold for whoever asks."""
    return settings.auth == "users" and not principal.may_ever(Scope.MAINTAIN)


def require_evaluation(session: Session, principal: Principal, settings: Settings) -> None:
    """Does nothing if the evaluation that this transaction has just added is within the quotas.

    Raises:
        Problem: 429, it is not; it says when there is room again.
    """
    if not is_bound(principal, settings):
        return
    user = session.get_one(User, principal.user)
    found = of(session, user, settings, bound=True)
    if _exceeds(found.attempts):
        begun = _attempts(session, user.id)
        raise _used_up("attempts", "evaluations in 24 hours", found.attempts, begun, DAY)
    if _exceeds(found.scored):
        begun = _scored(session, user.id)
        raise _used_up("scored", "scored evaluations in 30 days", found.scored, begun, MONTH)


def require_room(session: Session, principal: Principal, settings: Settings, more: int) -> None:
    """Does nothing if a checkpoint of so many bytes is within the user's storage.

    Raises:
        Problem: 413, it is not.
    """
    if not is_bound(principal, settings):
        return
    user = session.get_one(User, principal.user)
    found = of(session, user, settings, bound=True).storage
    if found.limit is not None and found.used + more > found.limit:
        raise Problem(
            413,
            "quota_storage",
            f"{more} bytes more would be {found.used + more}; your checkpoints may have "
            f"{found.limit} together.",
        )


def _exceeds(quota: Quota) -> bool:
    return quota.limit is not None and quota.used > quota.limit


def _used_up(
    name: str, what: str, quota: Quota, begun: list[datetime], window: timedelta
) -> Problem:
    limit = quota.limit or 0
    free = begun[-limit - 1] + window if limit else None  # the last is the one that is refused
    when = f"; there is room again at {free:%Y-%m-%d %H:%M} UTC" if free else ""
    wait = max(1, int((free - now()).total_seconds())) if free else None
    headers = {"Retry-After": str(wait)} if wait else {}
    return Problem(
        429, f"quota_{name}", f"Your quota of {limit} {what} is used up{when}.", headers=headers
    )


def _attempts(session: Session, owner: str) -> list[datetime]:
    """When those that count were asked for, the oldest first."""
    return list(session.scalars(_counted(owner, DAY)))


def _counted(owner: str, window: timedelta) -> Select[datetime]:
    return (
        select(Evaluation.created)
        .where(
            Evaluation.owner_id == owner,
            Evaluation.created > now() - window,
            Evaluation.state != EvaluationState.INCOMPLETE,
            ~_never_begun(),
        )
        .order_by(Evaluation.created)
    )


def _never_begun() -> ColumnElement[bool]:
    return and_(Evaluation.state == EvaluationState.CANCELLED, Evaluation.started.is_(None))


def _scored(session: Session, owner: str) -> list[datetime]:
    """When those were asked for that the leaderboard shows, or will if nothing happens to them."""
    wanted = _counted(owner, MONTH).where(
        Evaluation.split == SCORED_SPLIT,
        Evaluation.episodes == suite.SPLITS[SCORED_SPLIT],
        Evaluation.state != EvaluationState.CANCELLED,
    )
    found = session.execute(wanted.add_columns(Evaluation.tasks))
    return [created for created, tasks in found if suites.is_suite(tasks)]


def is_scored(split: str, tasks: Iterable[str], episodes: int) -> bool:
    """True if so many episodes together count among the scored evaluations."""
    asked = set(tasks)
    whole = len(asked) * suite.SPLITS[SCORED_SPLIT]
    return split == SCORED_SPLIT and suites.is_suite(asked) and episodes == whole


def owns(session: Session, owner: str, sha256: str) -> bool:
    """True if a policy of the user plays this file."""
    found = (
        select(PolicyVersion.id)
        .join(Policy, PolicyVersion.policy_id == Policy.id)
        .where(Policy.owner_id == owner, PolicyVersion.spec["sha256"].as_string() == sha256)
        .limit(1)
    )
    return session.scalar(found) is not None


def stored(session: Session, owner: str) -> int:
    """Bytes of the checkpoints of a user's policies; each file counts once."""
    size = func.max(PolicyVersion.spec["size"].as_integer())
    sha256 = PolicyVersion.spec["sha256"].as_string()
    kind = PolicyVersion.spec["kind"].as_string()
    files = (
        select(size.label("size"))
        .join(Policy, PolicyVersion.policy_id == Policy.id)
        .where(Policy.owner_id == owner, kind == "checkpoint")
        .group_by(sha256)
        .subquery()
    )
    return session.scalar(select(func.coalesce(func.sum(files.c.size), 0))) or 0
