"""Who may remove files of a data folder, and when: nobody while they are being copied."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK = ".files.lock"


@contextmanager
def files_stay(folder: Path) -> Iterator[None]:
    """Waits until nobody removes files, and keeps them from it."""
    with _locked(folder, fcntl.LOCK_SH):
        yield


@contextmanager
def files_go(folder: Path) -> Iterator[None]:
    """Waits until nobody copies or removes files, and keeps them from it."""
    with _locked(folder, fcntl.LOCK_EX):
        yield


@contextmanager
def _locked(folder: Path, how: int) -> Iterator[None]:
    try:
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError:
        if how == fcntl.LOCK_EX:
            raise
        yield  # a folder that cannot be written: nothing is removed from it either
        return
    try:
        fcntl.flock(lock, how)
        yield
    finally:
        os.close(lock)
