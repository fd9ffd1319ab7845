"""The folder that holds everything a server keeps; one server at a time holds it."""

import fcntl
import os
from pathlib import Path

from server.db import LedgerError, examine
from server.settings import LEDGER

LOCK = ".lock"
FOLDERS = ("blobs", "growing", "logs", "uploads")


class DataFolderError(Exception):
    """The folder cannot be used; the message is one line, and nothing was touched."""


class DataFolder:
    """A data folder that is held until `close`.

    Raises:
        DataFolderError: it cannot be written, another server holds it, or its ledger cannot be
            used.
    """

    def __init__(self, path: Path):
        self.path = path.absolute()
        try:
            examine(self.ledger)
            self._make()
        except LedgerError as error:
            raise DataFolderError(str(error)) from None
        except OSError as error:
            raise DataFolderError(f"{path} cannot be written: {error.strerror}.") from None

    @property
    def ledger(self) -> Path:
        """The database file."""
        return self.path / LEDGER

    @property
    def blobs(self) -> Path:
        """Recordings and thumbnails."""
        return self.path / "blobs"

    @property
    def growing(self) -> Path:
        """Recordings of running episodes."""
        return self.path / "growing"

    @property
    def uploads(self) -> Path:
        """Checkpoints that have not come whole yet."""
        return self.path / "uploads"

    @property
    def logs(self) -> Path:
        """What workers print."""
        return self.path / "logs"

    def _make(self) -> None:
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise DataFolderError(
                f"{self.path} is in use by another server; stop it, or give another --data."
            ) from None
        try:
            for name in FOLDERS:
                (self.path / name).mkdir(exist_ok=True)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Lets another server have it."""
        os.close(self._lock)
