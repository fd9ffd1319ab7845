"""A first look in a minute or two: the expert and the amnesiac on a few episodes each.

What tells them apart is memory alone: both see perfectly and have the same skills.
"""

import hashlib

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import evaluations, idempotency
from server.access import Principal
from server.models import Evaluation
from server.schemas.evaluations import EvaluationCreate
from server.states import EvaluationState

POLICIES = ("expert", "amnesiac")
TASKS = ("push_button_times", "reopen_drawer", "swap_square_pegs")  # one of each category
EPISODES = 2  # of each task
UNFIT = (EvaluationState.CANCELLED, EvaluationState.INCOMPLETE)  # to be shown: another is begun


def wanted(policy: str) -> EvaluationCreate:
    """What is asked for of a policy: validation episodes, ahead of the references."""
    return EvaluationCreate(policy=policy, tasks=list(TASKS), split="val", episodes=EPISODES)


def keys(policy: str) -> list[str]:
    """Idempotency keys of a policy's tries, the first ones; they change with the tasks' code."""
    code = "".join(evaluations.current_sources()[task] for task in TASKS)
    digest = hashlib.sha256(code.encode()).hexdigest()[:16]
    return [f"demo {digest} {policy} {number}" for number in range(1, 21)]


def found(session: Session, principal: Principal) -> dict[str, Evaluation]:
    """The newest demo evaluation of each policy that whoever asks has begun."""
    newest: dict[str, Evaluation] = {}
    for policy in POLICIES:
        hashed = [idempotency.hashed(principal.user, key) for key in keys(policy)]
        own = select(Evaluation).where(Evaluation.idempotency_key.in_(hashed))
        one = session.scalar(own.order_by(Evaluation.id.desc()).limit(1))
        if one:
            newest[policy] = one
    return newest


def due(session: Session, principal: Principal) -> dict[str, str]:
    """The policies that are still to be begun, each with its key."""
    there = found(session, principal)
    return {
        policy: _next(session, principal, policy)
        for policy in POLICIES
        if policy not in there or there[policy].state in UNFIT
    }


def _next(session: Session, principal: Principal, policy: str) -> str:
    hashed = {idempotency.hashed(principal.user, key): key for key in keys(policy)}
    used = set(
        session.scalars(
            select(Evaluation.idempotency_key).where(Evaluation.idempotency_key.in_(hashed))
        )
    )
    free = [key for name, key in hashed.items() if name not in used]
    return free[0] if free else list(hashed.values())[-1]
