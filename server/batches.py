"""Many evaluations asked for at once: kept as asked, and worked off one by one.

Each item is a transaction of its own, so that workers are not kept waiting while hundreds of
thousands of rows are written, and one that cannot be does not hinder the others. What became of
it is noted in the same transaction; a batch that broke off goes on where it was.
"""

import hashlib
import json
from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import evaluations
from server.models import Batch, Evaluation, new_id
from server.paging import after, page
from server.problems import Problem, invalid, not_found
from server.schemas.common import Page
from server.schemas.evaluations import Batch as BatchDetail
from server.schemas.evaluations import BatchCreate, BatchItem, BatchPublic, Matrix

MOST = 200  # evaluations of one batch
Item = dict[str, Any]


def expanded(wanted: BatchCreate) -> list[Item]:
    """The evaluations that are asked for, one by one.

    Raises:
        Problem: 422, there are none, or too many.
    """
    items = list(wanted.items)
    if wanted.matrix:
        items += _of_matrix(wanted.matrix)
    if not items:
        raise invalid("items", "is empty; list evaluations, or give a matrix")
    if len(items) > MOST:
        raise invalid(
            "items", f"and matrix are {len(items)} evaluations; at most {MOST} go at once"
        )
    return items


def _of_matrix(matrix: Matrix) -> list[Item]:
    own = {"policies", "suites"}
    shared = matrix.model_dump(mode="json", exclude=own, exclude_unset=True)
    suites = [{"suite": name} for name in matrix.suites] if matrix.suites else [{}]
    return [{"policy": policy, **suite, **shared} for suite in suites for policy in matrix.policies]


def begun(session: Session, items: Sequence[Item], key: str | None, owner: str) -> Batch:
    """A new batch, or the one that the same user's same key asked for before.

    Raises:
        Problem: 422, the key was used for another request.
    """
    digest = hashlib.sha256(json.dumps(items, sort_keys=True).encode()).hexdigest()
    if key is not None:
        key = hashlib.sha256(f"{owner} {key}".encode()).hexdigest()
        if there := session.scalar(select(Batch).where(Batch.idempotency_key == key)):
            if there.request_digest != digest:
                raise invalid("Idempotency-Key", "was used for another request; choose a new key")
            return there
    batch = Batch(
        id=new_id("ba"),
        wanted=list(items),
        items=[],
        idempotency_key=key,
        request_digest=digest,
        owner_id=owner,
    )
    session.add(batch)
    session.flush()
    return batch


def due(batch: Batch, number: int) -> Item | None:
    """The item of this number; None if it was dealt with before."""
    return batch.wanted[number] if number == len(batch.items) else None


def accept(batch: Batch, evaluation: Evaluation) -> None:
    """Notes that the next item has become this evaluation."""
    batch.items = [*batch.items, {"status": 202, "evaluation": evaluation.id}]


def refuse(batch: Batch, problem: Problem) -> None:
    """Notes why nothing became of the next item."""
    batch.items = [*batch.items, {"status": problem.status, "problem": problem.document}]


# --- looked up ---


def row(session: Session, id: str) -> Batch:
    """The batch with this id.

    Raises:
        Problem: 404, there is none.
    """
    if found := session.get(Batch, id):
        return found
    raise not_found("batch", id)


def get(session: Session, id: str) -> BatchDetail:
    """A batch with its evaluations as they stand.

    Raises:
        Problem: 404, there is none.
    """
    batch = row(session, id)
    ids = [item["evaluation"] for item in batch.items if "evaluation" in item]
    rows = session.scalars(select(Evaluation).where(Evaluation.id.in_(ids))).all()
    stand = {one.id: one for one in evaluations.public_all(session, rows)}
    items = [
        BatchItem(
            status=item["status"],
            evaluation=stand.get(item.get("evaluation", "")),
            problem=item.get("problem"),
        )
        for item in batch.items
    ]
    return BatchDetail(**dict(public(batch)), items=items)


def listed(session: Session, *, limit: int = 50, cursor: str | None = None) -> Page[BatchPublic]:
    """Batches, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(Batch).order_by(Batch.id.desc()).limit(limit + 1)
    if place := after(cursor, [str]):
        wanted = wanted.where(Batch.id < place[0])
    rows = session.scalars(wanted).all()
    return page(rows, limit, lambda one: [one.id], public)


def public(batch: Batch) -> BatchPublic:
    """A batch in numbers."""
    accepted = sum("evaluation" in item for item in batch.items)
    return BatchPublic(
        id=batch.id,
        created=batch.created,
        owner=batch.owner and batch.owner.name,
        expected=len(batch.wanted),
        accepted=accepted,
        refused=len(batch.items) - accepted,
    )
