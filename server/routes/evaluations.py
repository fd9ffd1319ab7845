"""Evaluations: asked for, followed, stopped."""

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import Header, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from sqlalchemy.orm import Session

from server import episodes, estimates, evaluations, followers, lifecycle, quotas
from server.access import Principal, Router, Scope, needs
from server.deps import Cursor, EvaluationId, Limit, Reading, TheHub, ThePrincipal
from server.hub import Hub
from server.models import Evaluation
from server.schemas.common import Page
from server.schemas.episodes import FailureGroup
from server.schemas.evaluations import (
    AttemptPublic,
    EstimatePublic,
    EstimateQuery,
    EvaluationCreate,
    EvaluationPublic,
)
from server.states import EvaluationState

router = Router(tags=["evaluations"])
LAST_EVENT = 2**63 - 1  # what the ledger can number
IdempotencyKey = Annotated[
    str | None,
    Header(max_length=200, description="The same key and request again give the same evaluation."),
]


@router.post("/evaluations", status_code=202)
@needs(Scope.SUBMIT)
def create_evaluation(
    wanted: EvaluationCreate,
    hub: TheHub,
    principal: ThePrincipal,
    response: Response,
    idempotency_key: IdempotencyKey = None,
) -> EvaluationPublic:
    """Queues an evaluation."""
    created = _create(hub, principal, wanted, idempotency_key)
    response.headers["Location"] = f"/api/v1/evaluations/{created.id}"
    return created


def _create(
    hub: Hub, principal: Principal, wanted: EvaluationCreate, key: str | None = None
) -> EvaluationPublic:
    with hub.database.writing() as session:
        row = queued(session, hub, principal, wanted, key)
        stands = evaluations.public(session, row)
    hub.bell.reconciler.set()
    return stands


def queued(
    session: Session,
    hub: Hub,
    principal: Principal,
    wanted: EvaluationCreate,
    key: str | None = None,
) -> Evaluation:
    """A new evaluation that whoever asks may ask for.

    Raises:
        Problem: 422, it is wrong; 429, their quota is used up.
    """
    evaluations.require_priority(principal, wanted.priority)
    row = evaluations.create(session, wanted, key, owner=principal.user)
    session.flush()
    quotas.require_evaluation(session, principal, hub.settings)
    return row


@router.get("/evaluations")
@needs(Scope.READ)
def list_evaluations(
    session: Reading,
    state: EvaluationState | None = None,
    policy: Annotated[str | None, Query(max_length=80)] = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[EvaluationPublic]:
    """Evaluations, the newest first."""
    return evaluations.listed(session, state=state, policy=policy, limit=limit, cursor=cursor)


@router.get("/evaluations/estimate")
@needs(Scope.SUBMIT)
def estimate_evaluation(
    wanted: Annotated[EstimateQuery, Query()],
    hub: TheHub,
    principal: ThePrincipal,
    session: Reading,
) -> EstimatePublic:
    """What an evaluation would cost, and what goes before it; nothing is queued."""
    return estimates.of(session, hub, principal, wanted)


@router.get("/evaluations/{evaluation}")
@needs(Scope.READ)
def get_evaluation(evaluation: str, session: Reading) -> EvaluationPublic:
    """One evaluation with its progress and its rates so far."""
    return evaluations.get(session, evaluation)


@router.get("/evaluations/{evaluation}/attempts")
@needs(Scope.READ)
def list_attempts(
    evaluation: str, session: Reading, limit: Limit = 50, cursor: Cursor = None
) -> Page[AttemptPublic]:
    """Every try at one of its shards, the newest first."""
    return evaluations.attempts_listed(session, evaluation, limit=limit, cursor=cursor)


@router.get("/evaluations/{evaluation}/failures")
@needs(Scope.READ)
def count_failures(evaluation: EvaluationId, session: Reading) -> list[FailureGroup]:
    """How many episodes failed in which way."""
    return episodes.failure_groups(session, evaluation=evaluation)


@router.post("/evaluations/{evaluation}/cancellation", status_code=202)
@needs(Scope.SUBMIT)
def cancel_evaluation(evaluation: str, hub: TheHub, principal: ThePrincipal) -> EvaluationPublic:
    """Stops an evaluation of one's own; what is final stays."""
    with hub.database.writing() as session:
        row = evaluations.row(session, evaluation)
        principal.require_own(row.owner_id, f"Evaluation {row.id}")
        lifecycle.cancel(session, row)
        session.flush()
        stands = evaluations.public(session, row)
    hub.bell.reconciler.set()
    return stands


@router.post("/evaluations/{evaluation}/resumption", status_code=202)
@needs(Scope.SUBMIT)
def resume_evaluation(evaluation: str, hub: TheHub, principal: ThePrincipal) -> EvaluationPublic:
    """Plays what an incomplete evaluation lacks; final episodes stay as they are."""
    with hub.database.writing() as session:
        row = evaluations.row(session, evaluation)
        principal.require_own(row.owner_id, f"Evaluation {row.id}")
        lifecycle.resume(session, row, evaluations.current_sources())
        session.flush()
        stands = evaluations.public(session, row)
    hub.bell.reconciler.set()
    return stands


@router.get("/evaluations/{evaluation}/events", response_class=EventSourceResponse)
@needs(Scope.READ)
async def follow_evaluation(
    evaluation: EvaluationId,
    hub: TheHub,
    after: Annotated[
        int, Query(ge=0, le=LAST_EVENT, description="Only events after this number.")
    ] = 0,
    last_event_id: Annotated[int | None, Header(ge=0, le=LAST_EVENT)] = None,
) -> AsyncIterator[ServerSentEvent]:
    """What happens to it, as server-sent events, until it has ended.

    `episode`, `evaluation`, `attempt`, `fault` and `divergence` are kept and have numbers;
    `progress` is said after them and has none.
    """
    async for event in followers.follow(hub, evaluation, last_event_id or after):
        yield event
