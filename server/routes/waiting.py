"""What waits, and what is played."""

from server import waiting
from server.access import Router, Scope, needs
from server.deps import EvaluationId, Limit, Reading, TheHub
from server.problems import Problem
from server.schemas.queue import Queue, QueueItem, Workers

router = Router(tags=["evaluations"])


@router.get("/queue")
@needs(Scope.READ)
def get_queue(session: Reading, hub: TheHub, limit: Limit = 50) -> Queue:
    """Evaluations of which shards wait, in the order in which they are handed out, and why."""
    return waiting.queue(session, hub, limit=limit)


@router.get("/evaluations/{evaluation}/queue")
@needs(Scope.READ)
def get_place(evaluation: EvaluationId, session: Reading, hub: TheHub) -> QueueItem:
    """Where an evaluation stands in the queue, and why it waits."""
    if found := waiting.place(session, hub, evaluation):
        return found
    raise Problem(404, "not_found", f"No shard of {evaluation} waits.")


@router.get("/workers")
@needs(Scope.READ)
def list_workers(session: Reading, hub: TheHub) -> Workers:
    """What each worker is doing: the shards that are handed out, and their episodes."""
    return waiting.workers(session, hub)
