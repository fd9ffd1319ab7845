"""Files kept under their SHA-256: recordings, thumbnails, checkpoints. Written whole or not at all.

What the ledger refers to stays, but for recordings that make room (server/retention.py).
"""

import hashlib
import os
import re
from pathlib import Path

from sqlalchemy.orm import Session

from server.models import Blob, Removal

RRD = "application/vnd.rerun.rrd"
JPEG = "image/jpeg"
CHECKPOINT = "application/vnd.safetensors"
PART = ".part"
SHA256 = re.compile("[0-9a-f]{64}")


class Blobs:
    """A folder of blobs, `ab/cdef…`."""

    def __init__(self, folder: Path):
        self.folder = folder

    def path(self, sha256: str) -> Path:
        """Where a blob is, or would be."""
        return self.folder / sha256[:2] / sha256[2:]

    def holds(self, sha256: str) -> bool:
        """True if the blob is here; false for what is no SHA-256 at all."""
        return bool(SHA256.fullmatch(sha256)) and self.path(sha256).exists()

    def take(self, file: Path, sha256: str) -> None:
        """Moves a finished file of the same file system in, power cuts included."""
        target = self.path(sha256)
        target.parent.mkdir(parents=True, exist_ok=True)
        with open(file, "rb") as content:
            os.fsync(content.fileno())
        file.replace(target)
        sync_folder(target.parent)
        sync_folder(self.folder)  # target.parent may be its newest entry

    def clear_parts(self) -> None:
        """Removes half-written files; a whole one stays, even if this ledger does not know it."""
        for file in self.folder.glob(f".*{PART}"):
            file.unlink()

    def new_part(self) -> Path:
        """A path in this folder for a file that is still coming in."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return self.folder / f".{os.urandom(16).hex()}{PART}"

    def put(self, content: bytes) -> str:
        """Keeps some bytes; their SHA-256."""
        sha256 = hashlib.sha256(content).hexdigest()
        if not self.path(sha256).exists():
            part = self.new_part()
            try:
                part.write_bytes(content)
                self.take(part, sha256)
            finally:
                part.unlink(missing_ok=True)  # there was no room for it
        return sha256


def sync_folder(folder: Path) -> None:
    """Makes a rename within a folder outlive a power cut."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def note(session: Session, sha256: str, size: int, media_type: str) -> str:
    """Enters a blob into the ledger, once; one that was removed before is there again."""
    if session.get(Blob, sha256) is None:
        session.add(Blob(sha256=sha256, size=size, media_type=media_type))
    if removal := session.get(Removal, sha256):
        session.delete(removal)
    session.flush()
    return sha256
