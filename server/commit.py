"""A finished episode enters the ledger: once, whole, and only from the current attempt."""

import math
from collections.abc import Sequence
from itertools import chain
from typing import Any

from sqlalchemy import insert
from sqlalchemy.orm import Session

from hide_tasks.suite import committed
from server import blobs, lifecycle, spans
from server.blobs import Blobs
from server.models import (
    Attempt,
    Base,
    Decision,
    Divergence,
    Episode,
    HiddenChange,
    HiddenSpan,
    new_id,
    now,
)
from server.problems import Problem, invalid
from server.states import EpisodeState
from workers.protocol import Committed, EpisodeCommit, measured_digest
from workers.protocol import HiddenChange as HiddenMoment


def commit(
    session: Session, store: Blobs, attempt: Attempt, episode: Episode, what: EpisodeCommit
) -> Committed | Problem:
    """Makes the episode final; `already` if the same result is there.

    A different result of a final episode is noted, and answered with the problem `diverged`: it
    is returned, not raised, because the note is to be kept.

    Raises:
        Problem: 422, it is not this episode's result, or damaged; 409, the attempt is stale.
    """
    _check(episode, what, store)
    if episode.state == EpisodeState.FINAL:
        return _again(session, attempt, episode, what)
    lifecycle.require_open(attempt)
    if episode.fence != attempt.fence:
        raise Problem(409, "stale_attempt", f"Episode {episode.id} was not begun by this attempt.")
    _add_rows(session, episode, what)
    _finish(session, store, episode, what)
    _tell_machine(attempt, what)
    session.flush()
    lifecycle.tell_episode(session, episode)
    return Committed(already=False)


def _check(episode: Episode, what: EpisodeCommit, store: Blobs) -> None:
    """Refuses what cannot be this episode's result."""
    result = what.result
    if what.digest != measured_digest(result, what.start, what.decisions, what.changes):
        raise invalid("digest", "does not belong to the content; it was damaged on its way")
    for field in ("task", "split", "index", "variation"):
        if getattr(result, field) != getattr(episode, field):
            raise invalid(
                f"result.{field}", f"is {getattr(result, field)}, not {getattr(episode, field)}"
            )
    hashes = committed(episode.task).get("splits", {}).get(episode.split, {})
    wanted = hashes.get("scene_hashes", [])[episode.index : episode.index + 1]
    if wanted and not result.scene_hash.startswith(wanted[0]):
        raise invalid("result.scene_hash", f"is {result.scene_hash}, not {wanted[0]}…")
    if [one.decision for one in what.decisions] != list(range(result.decisions)):
        raise invalid("decisions", f"are not {result.decisions}, numbered from 0")
    if not all(_is_within(change, result.decisions) for change in what.changes):
        raise invalid("changes", "hold a number that no moment of the episode can have")
    if what.recording is not None and not store.holds(what.recording):
        raise invalid("recording", f"no recording {what.recording[:64]} was sent before")


def _is_within(change: HiddenMoment, decisions: int) -> bool:
    lists = (value if isinstance(value, list) else [value] for value in change.hidden.values())
    numbers = [one for one in (change.time, *chain.from_iterable(lists)) if isinstance(one, float)]
    finite = all(map(math.isfinite, numbers))
    return finite and change.time >= 0 and 0 <= change.decision <= decisions


def _again(
    session: Session, attempt: Attempt, episode: Episode, what: EpisodeCommit
) -> Committed | Problem:
    """A second result of a final episode: the same is fine, another is an alarm."""
    if what.digest == episode.digest:
        return Committed(already=True)
    assert episode.digest is not None
    session.add(
        Divergence(
            id=new_id("dv"),
            episode_id=episode.id,
            attempt_id=attempt.id,
            kept=episode.digest,
            other=what.digest,
            result=what.result.model_dump(mode="json"),
        )
    )
    lifecycle.emit(session, episode.evaluation_id, "divergence", id=episode.id, kept=episode.digest)
    return Problem(
        409,
        "diverged",
        f"Episode {episode.id} is final with another result; that one stays, this one is noted.",
    )


def _add_rows(session: Session, episode: Episode, what: EpisodeCommit) -> None:
    decisions = [
        {
            "episode_id": episode.id,
            "number": one.decision,
            **one.model_dump(mode="json", exclude={"decision"}),
        }
        for one in what.decisions
    ]
    changes = [
        {"episode_id": episode.id, "number": number, **change.model_dump(mode="json")}
        for number, change in enumerate(what.changes)
    ]
    derived = spans.derive(what.start, what.decisions, what.changes)
    _insert(session, Decision, decisions)
    _insert(session, HiddenChange, changes)
    _insert(session, HiddenSpan, [{"episode_id": episode.id, **vars(span)} for span in derived])


def _insert(session: Session, table: type[Base], rows: Sequence[dict[str, Any]]) -> None:
    if rows:
        session.execute(insert(table), rows)


def _tell_machine(attempt: Attempt, what: EpisodeCommit) -> None:
    if attempt.machine is None:
        attempt.machine = what.machine


def _finish(session: Session, store: Blobs, episode: Episode, what: EpisodeCommit) -> None:
    result = what.result
    if what.recording:
        size = store.path(what.recording).stat().st_size
        episode.recording = blobs.note(session, what.recording, size, blobs.RRD)
    if what.thumbnail:
        sha256 = store.put(what.thumbnail)
        episode.thumbnail = blobs.note(session, sha256, len(what.thumbnail), blobs.JPEG)
    for field in ("success", "exact", "detail", "instruction", "decisions", "stage"):
        setattr(episode, field, getattr(result, field))
    episode.failure = result.failure
    episode.scene_hash = result.scene_hash
    episode.final_state_hash = result.final_state_hash
    episode.start = what.start.model_dump(mode="json")
    episode.timing = result.timing.model_dump(mode="json")
    episode.digest = what.digest
    episode.sandbox = what.sandbox
    episode.committed = now()
    episode.state = EpisodeState.FINAL
