"""A copy of a data folder, made while its server runs, and put back into place.

The ledger is copied first, by SQLite's own online backup, as one state of it. The files that it
names are there before it names them and stay while a copy is made (server/keeping.py), so what is
copied afterwards is whole. Uploads that have not come whole, and logs, are not copied.
"""

import json
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field
from hashlib import sha256 as new_digest
from pathlib import Path

from server.blobs import PART, Blobs, sync_folder
from server.db import LedgerError, examine, revision_of, untouched
from server.keeping import files_stay
from server.models import now
from server.read_only import ReadOnlyFolder
from server.settings import LEDGER
from workers.policies import hash_of_file

MANIFEST = "backup.json"
FORMAT = 1
OURS = {MANIFEST, LEDGER, "blobs"}
PIECE = 2**20  # bytes
TOLD_EVERY = 500  # files
Say = Callable[[str], None]
Named = tuple[str, int]  # SHA-256 and bytes of a file


class BackupError(Exception):
    """It cannot be copied, or put back; the message is one line, and nothing was touched."""


@dataclass(frozen=True)
class Copied:
    """What a backup holds."""

    created: str
    revision: str  # of the ledger
    ledger: str  # SHA-256
    files: int
    bytes: int  # of the files
    faults: list[str] = field(default_factory=list)  # files that were not copied, and why
    format: int = FORMAT


def back_up(source: ReadOnlyFolder, target: Path, say: Say = lambda _: None) -> Copied:
    """Copies a data folder; a backup that is there already is brought up to date.

    Raises:
        BackupError: the target is something else's, or too small.
        OSError: it cannot be written.
    """
    target = target.absolute()
    _require_ours(target, source.path)
    with files_stay(source.path):
        target.mkdir(parents=True, exist_ok=True)
        part = target / f".{LEDGER}{PART}"
        try:
            _copy_ledger(source, part)
            wanted = named_files(part)
            store = Blobs(target / "blobs")
            _require_room(part.parent, [one for one in wanted if not _is_there(store, *one)])
            faults = _copy_files(wanted, source.blobs, store, say)
            copied = _described(part, wanted, faults)
            _put_in_place(part, target, copied)
        finally:
            part.unlink(missing_ok=True)
    return copied


def restore(backup: Path, target: Path, say: Say = lambda _: None) -> Copied:
    """Makes a data folder of a backup; files that are damaged are left out and named.

    The ledger gets its name last, so a folder has it only once it is whole; one that broke off
    is gone on with.

    Raises:
        BackupError: it is no backup, or not whole; the target holds something else.
        OSError: the target cannot be written.
    """
    copied, target = _read(backup), target.absolute()
    part = target / f".{LEDGER}{PART}"
    _require_free(target, part)
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(backup / LEDGER, part)
    wanted, store = named_files(part), Blobs(target / "blobs")
    _require_room(target, [one for one in wanted if not _is_there(store, *one)])
    faults = _copy_files(wanted, Blobs(backup / "blobs"), store, say)
    _sync(part)
    part.replace(target / LEDGER)
    sync_folder(target)
    done = {"faults": faults, "files": len(wanted) - len(faults)}
    return Copied(**{**asdict(copied), **done})


def _require_free(target: Path, part: Path) -> None:
    """Refuses a folder that holds anything, but for a restoration that broke off."""
    names = {file.name for file in target.iterdir()} if target.is_dir() else set()
    broke_off = part.name in names and not names - {part.name, "blobs"}
    if (names and not broke_off) or (target.exists() and not target.is_dir()):
        raise BackupError(f"{target} holds something; move it away, or give another --data.")


def named_files(ledger: Path) -> list[Named]:
    """The files that a ledger names and that were not removed on purpose."""
    with closing(sqlite3.connect(untouched(ledger), uri=True)) as opened:
        tables = {name for (name,) in opened.execute("SELECT name FROM sqlite_master")}
        removed = "WHERE sha256 NOT IN (SELECT sha256 FROM removals)"
        query = f"SELECT sha256, size FROM blobs {removed if 'removals' in tables else ''}"
        return [(str(one), int(size)) for one, size in opened.execute(f"{query} ORDER BY sha256")]


# --- its steps ---


def _require_ours(target: Path, source: Path) -> None:
    if target == source or source in target.parents:
        raise BackupError(f"{target} is within the data folder; give a folder on another disk.")
    if not target.exists():
        return
    if not target.is_dir():
        raise BackupError(f"{target} is a file; give a folder for the backup.")
    names = {file.name for file in target.iterdir() if not file.name.endswith(PART)}
    if names - OURS or (LEDGER in names and MANIFEST not in names):
        other = min(names - OURS, default=LEDGER)
        raise BackupError(f"{target} holds something else ({other}); give a new folder.")


def _copy_ledger(source: ReadOnlyFolder, part: Path) -> None:
    """One state of the ledger, in one step: of several, each write would begin the copy anew."""
    part.unlink(missing_ok=True)
    with closing(source.connect()) as original, closing(sqlite3.connect(part)) as copy:
        original.backup(copy)
    examine(part)


def _require_room(folder: Path, wanted: Sequence[Named]) -> None:
    needed = sum(size for _, size in wanted)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise BackupError(f"{folder} has {free} bytes free, and {needed} are needed.")


def _is_there(store: Blobs, sha256: str, size: int) -> bool:
    """True for a file that an earlier backup brought; its hash was computed then."""
    path = store.path(sha256)
    return path.is_file() and path.stat().st_size == size


def _copy_files(wanted: Sequence[Named], source: Blobs, target: Blobs, say: Say) -> list[str]:
    """Copies what is not there yet; which files could not be, and why."""
    faults = []
    for number, (sha256, size) in enumerate(wanted, start=1):
        if not _is_there(target, sha256, size) and (fault := _copy(sha256, source, target)):
            faults.append(f"{sha256}: {fault}")
        if number % TOLD_EVERY == 0:
            say(f"{number} of {len(wanted)} files")
    return faults


def _copy(sha256: str, source: Blobs, target: Blobs) -> str | None:
    """Why a file was not copied; None if it was."""
    part = target.new_part()
    try:
        digest = new_digest()
        with part.open("xb") as copy:
            for piece in _pieces(source.path(sha256)):
                digest.update(piece)
                copy.write(piece)
        if digest.hexdigest() != sha256:
            return f"is damaged: its content has SHA-256 {digest.hexdigest()}"
        target.take(part, sha256)
    except FileNotFoundError:
        return "is gone"
    finally:
        part.unlink(missing_ok=True)
    return None


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            yield piece


def _described(ledger: Path, wanted: Sequence[Named], faults: list[str]) -> Copied:
    with closing(sqlite3.connect(untouched(ledger), uri=True)) as opened:
        revision = revision_of(opened)
    return Copied(
        created=now().isoformat("T", "seconds"),
        revision=revision or "",
        ledger=hash_of_file(ledger),
        files=len(wanted) - len(faults),
        bytes=sum(size for _, size in wanted),
        faults=faults,
    )


def _put_in_place(part: Path, target: Path, copied: Copied) -> None:
    """The ledger, then what says that it is whole."""
    _sync(part)
    for suffix in ("-wal", "-shm"):  # of the former one, if somebody looked into it
        (target / f"{LEDGER}{suffix}").unlink(missing_ok=True)
    part.replace(target / LEDGER)
    manifest = target / f".{MANIFEST}{PART}"
    manifest.write_text(json.dumps(asdict(copied), indent=1) + "\n")
    _sync(manifest)
    manifest.replace(target / MANIFEST)
    sync_folder(target)


def _sync(file: Path) -> None:
    with file.open("rb") as opened:
        os.fsync(opened.fileno())


def _read(backup: Path) -> Copied:
    """What a backup says of itself, once its ledger is found to be whole."""
    known = {}
    with suppress(OSError, ValueError):
        known = json.loads((backup / MANIFEST).read_text())
    if not isinstance(known, dict) or not known.keys() >= {"format", "ledger", "revision"}:
        raise BackupError(f"{backup} is no backup: it has no {MANIFEST} of hide backup.")
    if known["format"] != FORMAT:
        raise BackupError(f"{backup} was made by a newer version; update hide-seek.")
    ledger = backup / LEDGER
    if not ledger.is_file() or hash_of_file(ledger) != known["ledger"]:
        raise BackupError(f"{backup} is not whole: its ledger is not the one that was copied.")
    try:
        examine(ledger)
    except LedgerError as error:
        raise BackupError(str(error)) from None
    return Copied(**known)
