"""How the episodes of completed evaluations went. What is completed never changes, so it is kept.

A thousand evaluations are hundreds of thousands of rows; the leaderboard reads each once.
"""

import threading
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.models import Episode

MOST = 20_000  # evaluations that are kept: 750 bytes each of the whole suite
AT_ONCE = 100  # evaluations of one query


class Outcomes(NamedTuple):
    """The verdicts of an evaluation's final episodes, by task and index."""

    episodes: tuple[tuple[str, int], ...]  # one object for all evaluations of the same episodes
    success: bytes  # 0 or 1
    exact: bytes


class _Kept:
    """Outcomes by evaluation, for all threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, Outcomes] = {}
        self._episodes: dict[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...]] = {}

    def get(self, ids: Iterable[str]) -> dict[str, Outcomes]:
        with self._lock:
            return {id: self._found[id] for id in ids if id in self._found}

    def put(self, found: dict[str, Outcomes]) -> None:
        with self._lock:
            if len(self._found) + len(found) > MOST:
                self._found.clear()
                self._episodes.clear()
            for id, one in found.items():
                same = self._episodes.setdefault(one.episodes, one.episodes)
                self._found[id] = one._replace(episodes=same)


_kept = _Kept()


def of_completed(session: Session, evaluations: Sequence[str]) -> dict[str, Outcomes]:
    """Outcomes of evaluations that are completed."""
    found = _kept.get(evaluations)
    missing = [id for id in evaluations if id not in found]
    read = as_stored(session, missing)
    _kept.put(read)
    return found | read


def as_stored(session: Session, evaluations: Sequence[str]) -> dict[str, Outcomes]:
    """Outcomes as the database has them now, kept ones or not."""
    found: dict[str, Outcomes] = {}
    for first in range(0, len(evaluations), AT_ONCE):
        found |= _read(session, evaluations[first : first + AT_ONCE])
    return found


def _read(session: Session, evaluations: Sequence[str]) -> dict[str, Outcomes]:
    wanted = (
        select(Episode.evaluation_id, Episode.task, Episode.index, Episode.success, Episode.exact)
        .where(Episode.evaluation_id.in_(evaluations))
        .order_by(Episode.evaluation_id, Episode.task, Episode.index)
    )
    rows: dict[str, list[tuple[str, int, bool, bool]]] = {id: [] for id in evaluations}
    for evaluation, task, index, success, exact in session.execute(wanted):
        rows[evaluation].append((task, index, bool(success), bool(exact)))
    return {
        id: Outcomes(
            tuple((task, index) for task, index, *_ in found),
            bytes(success for *_, success, _ in found),
            bytes(exact for *_, exact in found),
        )
        for id, found in rows.items()
    }
