"""Server-sent events: what happens to an evaluation, told as it happens."""

from collections.abc import AsyncIterator, Sequence
from typing import Any, NamedTuple

from fastapi.sse import ServerSentEvent
from sqlalchemy import select
from starlette.concurrency import run_in_threadpool

from server import evaluations
from server.hub import Hub
from server.models import Event
from server.states import ENDED

PATIENCE = 15.0  # s after which the progress is told anew, and a dead connection is noticed
MOST = 500  # events of one look


class Look(NamedTuple):
    """What is new, and how it stands."""

    events: Sequence[tuple[int, str, dict[str, Any]]]
    progress: dict[str, Any]
    ended: bool


async def follow(hub: Hub, evaluation: str, after: int) -> AsyncIterator[ServerSentEvent]:
    """Every event after a number, then each new one; ends when the evaluation has ended."""
    while not hub.bell.closing:
        look = await run_in_threadpool(_look, hub, evaluation, after)
        for after, kind, payload in look.events:
            yield ServerSentEvent(data=payload, event=kind, id=str(after))
        yield ServerSentEvent(data=look.progress, event="progress")
        if look.ended and not look.events:
            return
        if not look.events:
            await hub.bell.wait(PATIENCE)


def _look(hub: Hub, evaluation: str, after: int) -> Look:
    with hub.database.reading() as session:
        new = (
            select(Event)
            .where(Event.evaluation_id == evaluation, Event.seq > after)
            .order_by(Event.seq)
            .limit(MOST)
        )
        events = [(event.seq, event.kind, event.payload) for event in session.scalars(new)]
        stands = evaluations.get(session, evaluation)
        progress = stands.model_dump(mode="json", include={"progress", "verdicts"})
        return Look(events, progress, stands.state in ENDED)
