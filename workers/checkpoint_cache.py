"""Checkpoints on a worker's machine: fetched once, verified by hash, shared by its processes.

A file that is being played is locked, so whoever makes room for another leaves it alone.
"""

import contextlib
import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

from workers.policies import SUFFIX, hash_of_file

FOLDER = "HIDE_WORKER_CACHE"  # in the environment: where they are kept
KEPT = 4  # files; the ones that were used last
PART = ".part"  # ends the name of a file that is still being fetched


class WrongContent(Exception):
    """What was fetched is not what was asked for."""


def default_folder() -> Path:
    """Where this user keeps them, as the environment says."""
    if named := os.environ.get(FOLDER):
        return Path(named)
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "hide-seek" / "checkpoints"


@contextlib.contextmanager
def held(sha256: str, fetch: Callable[[Path], None], folder: Path | None = None) -> Iterator[Path]:
    """A file with this content, which stays until the block ends.

    Args:
        sha256: of its content.
        fetch: writes the content to a path, if it is not here yet.
        folder: where files are kept; default_folder if it is not given.

    Raises:
        WrongContent: what was fetched has another hash.
        Exception: what fetch raises.
    """
    folder = folder or default_folder()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{sha256}{SUFFIX}"
    with contextlib.ExitStack() as stack:
        with _locked(path, fcntl.LOCK_EX):  # fetched by one, awaited by the others
            if not path.exists() or hash_of_file(path) != sha256:
                _fetch(path, sha256, fetch)
            file = stack.enter_context(path.open("rb"))
            fcntl.flock(file, fcntl.LOCK_SH)
        os.utime(path)
        make_room(folder)
        yield path


def make_room(folder: Path, kept: int = KEPT) -> None:
    """Removes the files that were used longest ago and are not held, but for so many."""
    for path in sorted(folder.glob(f"*{SUFFIX}"), key=_used, reverse=True)[kept:]:
        # Somebody fetches it, plays it, or has removed it.
        with contextlib.suppress(BlockingIOError, FileNotFoundError):
            _remove(path)


def _used(path: Path) -> float:
    with contextlib.suppress(FileNotFoundError):
        return path.stat().st_mtime
    return 0.0


def _remove(path: Path) -> None:
    at_once = fcntl.LOCK_EX | fcntl.LOCK_NB
    with _locked(path, at_once), path.open("rb") as file:
        fcntl.flock(file, at_once)
        path.unlink()


@contextlib.contextmanager
def _locked(path: Path, how: int) -> Iterator[None]:
    """Nobody else takes up or removes this file meanwhile; 16 locks serve all files."""
    with path.with_name(f".{path.name[0]}.lock").open("ab") as lock:
        fcntl.flock(lock, how)
        yield


def _fetch(path: Path, sha256: str, fetch: Callable[[Path], None]) -> None:
    for left in path.parent.glob(f".{sha256}.*{PART}"):  # of a process that was killed
        left.unlink(missing_ok=True)
    part = path.with_name(f".{sha256}.{uuid4().hex[:8]}{PART}")
    try:
        fetch(part)
        if (found := hash_of_file(part)) != sha256:
            raise WrongContent(f"The server sent a checkpoint with SHA-256 {found}, not {sha256}.")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
