"""What a new server does first: it evaluates its own policies, so that there is a scale."""

import logging

from sqlalchemy import select
from sqlalchemy.orm import Session

from seek_model import trained
from server import evaluations
from server.models import Evaluation, Policy
from server.schemas.evaluations import EvaluationCreate
from workers.policies import NO_TORCH, has_torch

logger = logging.getLogger(__name__)
ORDER = ("expert", "amnesiac", *trained.POLICIES, "random", "noop")


def evaluate_own(session: Session, *, episodes: int | None = None) -> bool:
    """Queues the server's own policies on all tasks if the ledger has no evaluation yet."""
    if session.scalar(select(Evaluation.id).limit(1)) is not None:
        return False
    for number, name in enumerate(_playable(session), start=1):  # in turn, behind users' own
        wanted = EvaluationCreate(policy=name, episodes=episodes, priority=-number)
        evaluations.create(session, wanted)
    return True


def _playable(session: Session) -> list[str]:
    own = set(session.scalars(select(Policy.name).where(Policy.owner_id.is_(None))))
    there = [name for name in ORDER if name in own]
    if has_torch():
        return there
    left_out = [name for name in there if name in trained.POLICIES]
    if left_out:
        logger.warning("Not evaluated: %s. %s", ", ".join(left_out), NO_TORCH)
    return [name for name in there if name not in left_out]
