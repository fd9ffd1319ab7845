"""Which episodes were played side by side: the lanes of an evaluation.

The events keep when each episode began and ended, also in tries that were lost. Workers have no
numbers in the ledger; what one attempt played stays in one lane, and lanes are as few as will do.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.models import Attempt, Episode, Event
from server.schemas.history import Lane, LaneSpan, Outcome
from server.states import EpisodeState

Spans = Mapping[str, Sequence[LaneSpan]]  # by shard


class Stint(NamedTuple):
    """What one attempt played."""

    start: datetime
    end: datetime
    spans: list[LaneSpan]


def spans(session: Session, id: str) -> dict[str, list[LaneSpan]]:
    """When each episode was played, by its shard, in the order in which that began."""
    of_shard = select(Episode.id, Episode.shard_id).where(Episode.evaluation_id == id)
    shards = {row.id: row.shard_id for row in session.execute(of_shard)}
    events = session.scalars(
        select(Event).where(Event.evaluation_id == id, Event.kind == "episode").order_by(Event.seq)
    )
    found: dict[str, list[LaneSpan]] = defaultdict(list)
    begun: dict[str, LaneSpan] = {}
    for event in events:
        told = event.payload
        if told["state"] == EpisodeState.RUNNING:
            begun[told["id"]] = span = LaneSpan(
                episode=told["id"], task=told["task"], index=told["index"],
                start=event.time, end=None, outcome="running",
            )  # fmt: skip
            found[shards[told["id"]]].append(span)
        elif told["id"] in begun:
            span = begun.pop(told["id"])
            span.end, span.outcome = event.time, _outcome(told)
    return found


def _outcome(told: dict[str, object]) -> Outcome:
    if told["state"] != EpisodeState.FINAL:
        return "lost"
    return "exact" if told["exact"] else "success" if told["success"] else "failed"


def _stints(attempts: Sequence[Attempt], found: Spans, until: datetime) -> list[Stint]:
    """What each attempt played, by its beginning."""
    by_shard: dict[str, list[Attempt]] = defaultdict(list)
    for attempt in attempts:
        by_shard[attempt.shard_id].append(attempt)
    played: dict[str, list[LaneSpan]] = defaultdict(list)
    for shard, own in found.items():
        for span in own:
            its = [one for one in by_shard[shard] if one.leased <= span.start]
            played[its[-1].id if its else shard].append(span)
    stints = [
        Stint(group[0].start, max(span.end or until for span in group), group)
        for group in played.values()
    ]
    return sorted(stints, key=lambda one: one.start)


def lanes(attempts: Sequence[Attempt], found: Spans, until: datetime) -> list[Lane]:
    """Each attempt's episodes in the first lane that is free: as many as were played at a time."""
    rows: list[list[LaneSpan]] = []
    free: list[datetime] = []
    for stint in _stints(attempts, found, until):
        number = next((n for n, at in enumerate(free) if at <= stint.start), len(rows))
        if number == len(rows):
            rows.append([])
            free.append(stint.end)
        rows[number] += stint.spans
        free[number] = stint.end
    return [Lane(number=n, spans=spans) for n, spans in enumerate(rows, start=1)]
