"""A new checkpoint's first run, and how its evaluation is found again."""

from collections.abc import Iterable

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import idempotency
from server.models import Evaluation, PolicyVersion


def key(version: PolicyVersion) -> str:
    """The idempotency key of the evaluation that tries a version."""
    return f"smoke of {version.id}"


def of(session: Session, versions: Iterable[PolicyVersion]) -> dict[str, str]:
    """The ids of the evaluations that tried these versions, by the versions' ids."""
    keys = {idempotency.hashed(one.policy.owner_id, key(one)): one.id for one in versions}
    wanted = select(Evaluation.idempotency_key, Evaluation.id)
    found = session.execute(wanted.where(Evaluation.idempotency_key.in_(keys)))
    return {keys[stored]: id for stored, id in found if stored}
