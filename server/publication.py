"""Publishing an evaluation: the leaderboard is kept with it in it, under a permanent link.

Nothing is published below 100 % coverage: neither part of a suite nor an unfinished evaluation.
"""

from sqlalchemy import select
from sqlalchemy.orm import Session, defer

from hide_tasks import SUITES, suite
from server import snapshots
from server.models import Evaluation, LeaderboardSnapshot
from server.problems import Problem
from server.schemas.history import PublicationPublic
from server.schemas.snapshots import SnapshotPublic
from server.states import EvaluationState


def of(session: Session, evaluation: Evaluation) -> PublicationPublic:
    """Whether an evaluation may be published, why not, and where it was."""
    why = hindrance(session, evaluation)
    completed = evaluation.state == EvaluationState.COMPLETED
    held = _held(session, evaluation) if completed else []
    return PublicationPublic(publishable=why is None, reason=why, snapshots=held)


def _held(session: Session, evaluation: Evaluation) -> list[SnapshotPublic]:
    """The snapshots that an evaluation is in; their content may be large, and is left there."""
    held = session.scalars(
        select(LeaderboardSnapshot)
        .options(defer(LeaderboardSnapshot.content))
        .where(
            LeaderboardSnapshot.suite == evaluation.suite,
            LeaderboardSnapshot.split == evaluation.split,
            LeaderboardSnapshot.content.contains(f'"evaluation":"{evaluation.id}"'),
        )
        .order_by(LeaderboardSnapshot.number)
    )
    return [snapshots.public(one) for one in held]


def hindrance(session: Session, one: Evaluation) -> str | None:
    """Why an evaluation may not be published; None if it may."""
    return _part(one) or _superseded(session, one)


def _part(one: Evaluation) -> str | None:
    """Why an evaluation is no whole one of the present suite; None if it is."""
    if one.state != EvaluationState.COMPLETED:
        return f"It is {one.state}; nothing is published before every episode is final."
    if one.suite not in SUITES or one.suite_version != suite.VERSION or one.rules != "hide":
        return "The leaderboards hold evaluations by the rules 'hide' of the present suites alone."
    tasks = SUITES[one.suite]
    if missing := set(tasks) - set(one.tasks):
        return (
            f"It lacks {len(missing)} of the suite's {len(tasks)} tasks; nothing is published "
            "below 100 % coverage."
        )
    most = suite.SPLITS.get(one.split)  # type: ignore[call-overload]
    if one.episodes != most:
        return (
            f"It played {one.episodes} of {most} episodes a task; nothing is published below "
            "100 % coverage."
        )
    return None


def _superseded(session: Session, one: Evaluation) -> str | None:
    later = session.scalars(
        select(Evaluation)
        .where(
            Evaluation.policy_version_id == one.policy_version_id,
            Evaluation.suite == one.suite,
            Evaluation.split == one.split,
            Evaluation.id > one.id,
        )
        .order_by(Evaluation.id.desc())
    )
    newer = next((other.id for other in later if _part(other) is None), None)
    return f"The leaderboard shows a newer one of this version, {newer}." if newer else None


def require_publishable(session: Session, evaluation: Evaluation) -> None:
    """Does nothing if an evaluation may be published.

    Raises:
        Problem: 409, it may not.
    """
    if why := hindrance(session, evaluation):
        raise Problem(409, "not_publishable", why)
