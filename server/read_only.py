"""A data folder that is read and never written, whether its server runs or not."""

import fcntl
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sqlalchemy import Connection, Engine, NullPool, create_engine, event

from server.blobs import Blobs
from server.data_folder import LOCK, DataFolderError
from server.db import LedgerError, examine, known_revisions, revision_of, untouched
from server.settings import LEDGER

BUSY_TIMEOUT = 30.0  # s


class ReadOnlyFolder:
    """A data folder's ledger and blobs. Made by `opened`."""

    def __init__(self, path: Path):
        self.path = path
        self.ledger = path / LEDGER
        self.blobs = Blobs(path / "blobs")

    @classmethod
    @contextmanager
    def opened(cls, path: Path) -> Iterator["ReadOnlyFolder"]:
        """The folder; while nobody runs a server on it, none can start.

        Raises:
            DataFolderError: it is no data folder.
            LedgerError: its ledger cannot be read, or is of another version.
        """
        folder = cls(path.absolute())
        if not folder.ledger.is_file():
            raise DataFolderError(f"{path} is no data folder of a server: it has no {LEDGER}.")
        with _held_still(folder.path / LOCK):
            examine(folder.ledger)
            yield folder

    def connect(self) -> sqlite3.Connection:
        """A connection of its own, which cannot write."""
        address = untouched(self.ledger)
        return sqlite3.connect(
            address, uri=True, timeout=BUSY_TIMEOUT, check_same_thread=False, isolation_level=None
        )

    def engine(self) -> Engine:
        """The same for SQLAlchemy; a transaction sees one state of the ledger.

        Raises:
            LedgerError: the ledger is of an older version, and was not brought up to date yet.
        """
        self._require_current()
        engine = create_engine("sqlite://", creator=self.connect, poolclass=NullPool)

        @event.listens_for(engine, "begin")
        def _begin(connection: Connection) -> None:
            connection.exec_driver_sql("BEGIN")

        return engine

    def _require_current(self) -> None:
        connection = self.connect()
        try:
            revision = revision_of(connection)
        finally:
            connection.close()
        newest = known_revisions()[0]
        if revision != newest:
            raise LedgerError(
                f"{self.ledger} is of revision {revision or 'none'}, and this version reads "
                f"{newest}; start the server once, which brings it up to date."
            )


@contextmanager
def _held_still(lock: Path) -> Iterator[None]:
    """Keeps servers from starting, unless one runs already: then SQLite's own locks do."""
    try:
        held = os.open(lock, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:  # a copy of a data folder on a disk that cannot be written, say
        yield
        return
    try:
        with suppress(BlockingIOError):
            fcntl.flock(held, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield
    finally:
        os.close(held)
