"""What happened to an evaluation, in plain words: a line an event."""

from collections.abc import Callable, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.models import Event
from server.paging import after, page
from server.schemas.common import Page
from server.schemas.history import LogLine
from server.states import AttemptState, EpisodeState, EvaluationState

TAIL = 200  # lines of a page

STATES = {
    EvaluationState.QUEUED: "queued",
    EvaluationState.RUNNING: "begun: its first shard was handed out",
    EvaluationState.COMPLETED: "completed: every episode is final",
    EvaluationState.INCOMPLETE: "incomplete",
    EvaluationState.CANCELLED: "cancelled; what is final stays",
}
ATTEMPTS = {
    AttemptState.DONE: "done",
    AttemptState.LOST: "lost; what it left goes back to the queue",
    AttemptState.CANCELLED: "stopped on request",
}
Told = dict[str, Any]


def tail(session: Session, evaluation: str, *, limit: int = TAIL) -> list[LogLine]:
    """The newest lines, the newest last."""
    newest = select(Event).where(Event.evaluation_id == evaluation)
    found = session.scalars(newest.order_by(Event.seq.desc()).limit(limit)).all()
    return [_line(one) for one in reversed(found)]


def listed(
    session: Session, evaluation: str, *, limit: int = 50, cursor: str | None = None
) -> Page[LogLine]:
    """Lines, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(Event).where(Event.evaluation_id == evaluation)
    if place := after(cursor, [int]):
        wanted = wanted.where(Event.seq < place[0])
    rows: Sequence[Event] = session.scalars(
        wanted.order_by(Event.seq.desc()).limit(limit + 1)
    ).all()
    return page(rows, limit, lambda one: [one.seq], _line)


def _line(event: Event) -> LogLine:
    level, text = WORDS.get(event.kind, _other)(event.payload)
    return LogLine(
        seq=event.seq,
        time=event.time,
        level=level,
        text=text,
        episode=event.payload.get("id"),
    )


Line = tuple[str, str]


def _evaluation(told: Told) -> Line:
    state = EvaluationState(told["state"])
    why = f": {told['reason']}" if told.get("reason") else ""
    return "bad" if state is EvaluationState.INCOMPLETE else "note", STATES[state] + why


def _episode(told: Told) -> Line:
    name = f"{told['task']} {told['index']}"
    if told["state"] == EpisodeState.RUNNING:
        return "", f"{name} begins"
    if told["state"] == EpisodeState.PENDING:
        return "note", f"{name} goes back to the queue"
    if told["exact"]:
        return "good", f"{name}: exact"
    what = "success, not exact" if told["success"] else "failed"
    return "bad", f"{name}: {what}, {str(told['failure']).replace('_', ' ')}"


def _attempt(told: Told) -> Line:
    state = AttemptState(told["state"])
    why = f" ({told['reason']})" if told.get("reason") else ""
    text = f"{told['task']}, attempt {told['fence']} of a shard: {ATTEMPTS[state]}{why}"
    return "bad" if state is AttemptState.LOST else "", text


def _fault(told: Told) -> Line:
    return (
        "bad",
        f"an episode could not be played, through no fault of the policy: {told['reason']}",
    )


def _divergence(_: Told) -> Line:
    return "bad", "a second, different result of a final episode was refused"


def _other(told: Told) -> Line:
    return "", ", ".join(f"{name} {value}" for name, value in told.items())


WORDS: dict[str, Callable[[Told], Line]] = {
    "evaluation": _evaluation,
    "episode": _episode,
    "attempt": _attempt,
    "fault": _fault,
    "divergence": _divergence,
}
