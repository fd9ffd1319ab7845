"""Batches: many evaluations asked for at once."""

from fastapi import Response
from pydantic import ValidationError

from server import batches
from server.access import Principal, Router, Scope, needs
from server.deps import Cursor, Limit, Reading, TheHub, ThePrincipal
from server.hub import Hub
from server.problems import Problem, of_exception, of_validation
from server.routes.evaluations import IdempotencyKey, queued
from server.schemas.common import Page
from server.schemas.evaluations import Batch, BatchCreate, BatchPublic, EvaluationCreate

router = Router(prefix="/batches", tags=["evaluations"])


@router.post("", status_code=202)
@needs(Scope.SUBMIT)
def create_batch(
    wanted: BatchCreate,
    hub: TheHub,
    principal: ThePrincipal,
    response: Response,
    idempotency_key: IdempotencyKey = None,
) -> Batch:
    """Queues many evaluations; one that cannot be does not hinder the others."""
    items = batches.expanded(wanted)
    with hub.database.writing() as session:
        id = batches.begun(session, items, idempotency_key, principal.user).id
    for number in range(len(items)):
        _work_off(hub, principal, id, number)
        hub.bell.reconciler.set()
    response.headers["Location"] = f"/api/v1/batches/{id}"
    with hub.database.reading() as session:
        return batches.get(session, id)


def _work_off(hub: Hub, principal: Principal, id: str, number: int) -> None:
    """Deals with an item of a batch; does nothing if that was done before."""
    try:
        with hub.database.writing() as session:
            batch = batches.row(session, id)
            if (item := batches.due(batch, number)) is not None:
                wanted = EvaluationCreate.model_validate(item)
                row = queued(session, hub, principal, wanted)
                batches.accept(batch, row)
    except Exception as error:  # what is queued already must be told, whatever happens to the rest
        problem = _problem_of(error)
        with hub.database.writing() as session:
            batch = batches.row(session, id)
            if batches.due(batch, number) is not None:
                batches.refuse(batch, problem)


def _problem_of(error: Exception) -> Problem:
    if isinstance(error, ValidationError):
        return of_validation(error.errors())
    return of_exception(error)


@router.get("")
@needs(Scope.READ)
def list_batches(session: Reading, limit: Limit = 50, cursor: Cursor = None) -> Page[BatchPublic]:
    """Batches in numbers, the newest first."""
    return batches.listed(session, limit=limit, cursor=cursor)


@router.get("/{batch}")
@needs(Scope.READ)
def get_batch(batch: str, session: Reading) -> Batch:
    """What became of every item, with its evaluation as it stands."""
    return batches.get(session, batch)
