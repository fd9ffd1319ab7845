"""Whether the server lives, and whether it can do its work."""

from fastapi import Response
from sqlalchemy import func, select

from hide_tasks import suite
from hide_tasks.machine import installed
from server.access import Gate, Router, needs
from server.deps import Reading, TheHub
from server.models import Attempt, Shard
from server.schemas.operation import Health
from server.states import AttemptState, ShardState

router = Router(tags=["health"])


@router.get("/health/live")
@needs(Gate.PUBLIC)
def is_alive() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/health/ready", responses={503: {"model": Health}})
@needs(Gate.PUBLIC)
def is_ready(hub: TheHub, session: Reading, response: Response) -> Health:
    """The ledger, the disk and the workers are in order; 503 if one is not."""
    running = select(func.count()).where(Attempt.state == AttemptState.OPEN)
    queued = select(func.count()).where(Shard.state == ShardState.PENDING)
    checks = {"ledger": "ok", "disk": "ok" if hub.has_room() else "full: nothing is handed out"}
    if hub.reconciler:
        checks["reconciler"] = hub.reconciler.fault or "ok"
    if hub.membership:
        checks["cluster"] = getattr(hub.engine, "fault", None) or "ok"
    good = all(found == "ok" for found in checks.values())
    response.status_code = 200 if good else 503
    return Health(
        status="ok" if good else "degraded",
        checks=checks,
        workers=hub.reconciler.slots() if hub.reconciler else 0,
        sandbox=hub.sandbox,
        running=session.scalar(running) or 0,
        queued=session.scalar(queued) or 0,
    )


@router.get("/version")
@needs(Gate.PUBLIC)
def get_version() -> dict[str, str]:
    """The versions of the software and of the suite."""
    version = installed("hide-seek") or "not installed"
    return {"hide_seek": version, "suite": f"{suite.SUITE} {suite.VERSION}"}
