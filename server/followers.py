"""Server-sent events: what happens to an evaluation, told as it happens."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from fastapi.sse import ServerSentEvent
from sqlalchemy import select
from starlette.concurrency import run_in_threadpool

from server import evaluations
from server.hub import Hub
from server.models import Event
from server.states import ENDED

PATIENCE = 15.0  # s between two looks when nothing happens
MOST = 500  # events of one look


class Look(NamedTuple):
    """What is new, and how it stands."""

    events: Sequence[tuple[int, str, dict[str, Any]]]
    progress: dict[str, Any]
    ended: bool


async def follow(hub: Hub, evaluation: str, after: int) -> AsyncIterator[ServerSentEvent]:
    """Every event after a number, then each new one; ends when the evaluation has ended."""
    told: dict[str, Any] = {}
    while not hub.bell.closing:
        ring = hub.bell.next_ring()
        look = await run_in_threadpool(_look, hub, evaluation, after)
        for after, kind, payload in look.events:
            yield ServerSentEvent(data=payload, event=kind, id=str(after))
        if look.events:
            continue  # there may be more
        if look.progress != told:
            told = look.progress
            yield ServerSentEvent(data=told, event="progress")
        if look.ended:
            return
        with suppress(TimeoutError):
            await asyncio.wait_for(ring.wait(), PATIENCE)


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
