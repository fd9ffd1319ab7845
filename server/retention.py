"""Recordings that make room: old ones go, results never do, and what went is said to be gone."""

import logging
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from server.blobs import PART, RRD, Blobs
from server.db import Database
from server.keeping import files_go
from server.models import Blob, Removal, now

logger = logging.getLogger(__name__)
EVERY = 3600.0  # s between two looks of a server
STILL_NEEDED = timedelta(days=1)  # a file that no row names may be of an episode on its way in


@dataclass(frozen=True)
class Rule:
    """Which recordings go."""

    days: float | None = None  # older ones
    most: int | None = None  # bytes of all of them; the oldest go first

    @property
    def empty(self) -> bool:
        """True if none go."""
        return self.days is None and self.most is None

    def reason(self, too_old: bool) -> str:
        """Why one went."""
        return f"older than {self.days:g} days" if too_old else f"more than {self.most} bytes"


@dataclass(frozen=True)
class Doomed:
    """A recording that is to go."""

    sha256: str
    size: int  # bytes
    reason: str


@dataclass(frozen=True)
class Orphan:
    """A file that no row of the ledger names, or only one that says it was removed."""

    path: Path
    size: int  # bytes


def doomed(session: Session, rule: Rule, at: datetime | None = None) -> list[Doomed]:
    """The recordings that a rule removes, the oldest first."""
    rows = session.execute(_kept()).all()
    total = sum(size for _, size, _ in rows)
    at, found = at or now(), []
    for sha256, size, created in rows:
        too_old = rule.days is not None and created < at - timedelta(days=rule.days)
        if too_old or (rule.most is not None and total > rule.most):
            found.append(Doomed(sha256, size, rule.reason(too_old)))
            total -= size
    return found


def _kept() -> Select[str, int, datetime]:
    """Recordings that are here, the oldest first."""
    return (
        select(Blob.sha256, Blob.size, Blob.created)
        .where(Blob.media_type == RRD, Blob.sha256.not_in(select(Removal.sha256)))
        .order_by(Blob.created, Blob.sha256)
    )


def kept(session: Session) -> tuple[int, int]:
    """How many recordings are here, and their bytes."""
    rows = session.execute(_kept()).all()
    return len(rows), sum(size for _, size, _ in rows)


def prune(database: Database, store: Blobs, rule: Rule) -> list[Doomed]:
    """Removes what a rule says; which recordings that were."""
    with files_go(store.folder.parent):
        with database.writing() as session:
            found = doomed(session, rule)
            session.add_all(Removal(sha256=one.sha256, reason=one.reason) for one in found)
        # Not before the ledger says so: a file that is left over by a crash here is an orphan.
        for one in found:
            store.path(one.sha256).unlink(missing_ok=True)
    return found


def orphans(session: Session, store: Blobs, at: datetime | None = None) -> list[Orphan]:
    """Files that nobody will ask for; what is new may be named in a moment."""
    limit = ((at or now()) - STILL_NEEDED).timestamp()
    return [
        Orphan(path, path.stat().st_size)
        for folder in sorted(store.folder.glob("[0-9a-f][0-9a-f]"))
        for path in _unnamed(session, folder)
        if path.stat().st_mtime < limit
    ]


def _unnamed(session: Session, folder: Path) -> Iterator[Path]:
    low, high = folder.name, f"{folder.name}g"  # g comes after every hexadecimal digit
    named = set(
        session.scalars(
            select(Blob.sha256).where(
                Blob.sha256 >= low,
                Blob.sha256 < high,
                Blob.sha256.not_in(select(Removal.sha256)),
            )
        )
    )
    for path in sorted(folder.iterdir()):
        if path.is_file() and folder.name + path.name not in named and path.suffix != PART:
            yield path


def prune_orphans(database: Database, store: Blobs) -> list[Orphan]:
    """Removes files that nobody will ask for; which those were."""
    # While nobody else writes: a file is named in the transaction that found it in its place.
    with files_go(store.folder.parent), database.writing() as session:
        found = orphans(session, store)
        for one in found:
            one.path.unlink(missing_ok=True)
    return found


class Retention:
    """A running server's: prunes at its start and every hour."""

    def __init__(self, database: Database, store: Blobs, rule: Rule):
        self.database, self.store, self.rule = database, store, rule
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="retention", daemon=True)

    def start(self) -> None:
        """Begins, unless nothing is ever to go."""
        if not self.rule.empty:
            self._thread.start()

    def stop(self) -> None:
        """Ends after the look under way."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout=30)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                _tell(prune(self.database, self.store, self.rule))
            except Exception:  # a full disk or a locked file must not end it
                logger.exception("Recordings could not be removed; it is tried again")
            self._stopping.wait(EVERY)


def _tell(removed: Sequence[Doomed]) -> None:
    if removed:
        size = sum(one.size for one in removed)
        logger.info("Recordings removed", extra={"recordings": len(removed), "bytes": size})
