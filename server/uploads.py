"""Uploads that go on where they broke off: the state that the tus protocol asks for.

The ledger knows whose an upload is and how long it is to be; how much has come is the size of its
file, so a killed server cannot be wrong about it. What has come is hashed as it comes, and once
more only by a server that did not see it come.
"""

import asyncio
import errno
import hashlib
import os
import shutil
from collections.abc import AsyncIterator, Callable
from datetime import timedelta
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.checkpoints import NO_ROOM, STILL_LIMIT, Received
from server.models import Upload, new_id, now
from server.problems import Problem, not_found

if TYPE_CHECKING:
    from hashlib import _Hash

STAYS = timedelta(hours=24)  # of an upload of which nothing more comes
MOST = 10  # uploads of one user that are not done
PIECE = 2**20  # bytes that are read at once


class Coming:
    """The file of one upload; one writer at a time."""

    def __init__(self, path: Path):
        self.path = path
        self.busy = asyncio.Lock()
        self._digest: _Hash | None = None
        self._hashed = 0  # bytes

    @property
    def size(self) -> int:
        """Bytes that have come."""
        return self.path.stat().st_size if self.path.exists() else 0

    async def add(
        self,
        pieces: AsyncIterator[bytes],
        *,
        most: int,
        has_room: Callable[[], bool],
        checksum: bytes | None = None,
    ) -> int:
        """Writes what comes behind what is there; how much there is then.

        With a checksum, SHA-256 of these pieces, all of them are kept or none.

        Raises:
            Problem: 408, it stood still; 413, it is more than most; 460, the checksum is another;
                507, no room.
            ClientDisconnect: it broke off; without a checksum, what came is kept.
        """
        start = self.size
        part = hashlib.sha256()
        try:
            await self._write(pieces, start, most, has_room, part)
            if checksum is not None and part.digest() != checksum:
                raise Problem(460, "checksum", "The checksum is another one; nothing was kept.")
        except BaseException:
            if checksum is not None:
                self.cut(start)
            raise
        return self.size

    async def _write(
        self,
        pieces: AsyncIterator[bytes],
        start: int,
        most: int,
        has_room: Callable[[], bool],
        part: "_Hash",
    ) -> None:
        whole, size = await asyncio.to_thread(self.digest), start
        clock = asyncio.get_running_loop().time
        try:
            async with asyncio.timeout(STILL_LIMIT) as still:
                with self.path.open("ab", buffering=0) as file:
                    async for piece in pieces:
                        still.reschedule(clock() + STILL_LIMIT)
                        if size + len(piece) > most:
                            raise Problem(413, "too_large", f"Upload-Length is {most} bytes.")
                        if not has_room():
                            raise Problem(507, "no_room", NO_ROOM)
                        _write_all(file, piece)
                        size += len(piece)
                        part.update(piece)
                        whole.update(piece)
                        self._hashed = size
        except TimeoutError:
            detail = f"No byte came for {STILL_LIMIT:g} s; go on at the new offset."
            raise Problem(408, "too_slow", detail) from None
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            raise Problem(507, "no_room", NO_ROOM) from None

    def cut(self, size: int) -> None:
        """Forgets what came behind this size."""
        os.truncate(self.path, size)
        self._digest = None

    def digest(self) -> "_Hash":
        """The hash of everything that has come; read again only if somebody else saw it come."""
        if self._digest is None or self._hashed != self.size:
            self._digest, self._hashed = hashlib.sha256(), 0
            if self.path.exists():
                with self.path.open("rb") as file:
                    while piece := file.read(PIECE):
                        self._digest.update(piece)
                        self._hashed += len(piece)
        return self._digest

    def copy(self, whole: Path) -> None:
        """Takes a file that is here already for what would come."""
        shutil.copyfile(whole, self.path)

    def received(self) -> Received:
        """The whole file, as a checkpoint that came in."""
        return Received(self.path, self.digest().hexdigest(), self.size)


def _write_all(file: FileIO, piece: bytes) -> None:
    """Writes a piece; an unbuffered file may take less of it than it was given."""
    rest = memoryview(piece)
    while rest:
        rest = rest[file.write(rest) :]


class Uploads:
    """The files of uploads, in a folder of the data folder's own file system."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._coming: dict[str, Coming] = {}

    def of(self, id: str) -> Coming:
        """The file of an upload that the ledger knows."""
        if id not in self._coming:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._coming[id] = Coming(self.folder / f"{id}.part")
        return self._coming[id]

    def remove(self, id: str) -> None:
        """Forgets an upload."""
        self._coming.pop(id, None)
        (self.folder / f"{id}.part").unlink(missing_ok=True)

    def sweep(self, session: Session) -> None:
        """Forgets what expired, and files that the ledger does not know."""
        for row in session.scalars(select(Upload).where(Upload.expires <= now())):
            session.delete(row)
        session.flush()
        known = set(session.scalars(select(Upload.id)))
        for file in self.folder.glob("*.part"):
            if file.stem not in known:
                self.remove(file.stem)


def create(
    session: Session,
    owner: str,
    *,
    length: int,
    name: str,
    description: str,
    sha256: str | None,
) -> Upload:
    """A new upload of which nothing has come.

    Raises:
        Problem: 429, the user has too many that are not done.
    """
    open_ones = select(func.count()).where(Upload.owner_id == owner, Upload.expires > now())
    if (session.scalar(open_ones) or 0) >= MOST:
        detail = f"You have {MOST} uploads that are not done; end one with DELETE."
        raise Problem(429, "too_many_uploads", detail)
    row = Upload(
        id=new_id("up"),
        owner_id=owner,
        length=length,
        name=name,
        description=description,
        sha256=sha256,
        expires=now() + STAYS,
    )
    session.add(row)
    session.flush()
    return row


def find(session: Session, id: str, owner: str) -> Upload:
    """The user's upload with this id; nobody else learns that it is there.

    Raises:
        Problem: 404, there is none; 410, it expired.
    """
    row = session.get(Upload, id)
    if row is None or row.owner_id != owner:
        raise not_found("upload", id)
    if row.expires <= now():
        raise Problem(410, "expired", f"Upload {id} expired; begin another.")
    return row


def of_user(session: Session, owner: str) -> list[Upload]:
    """A user's uploads that are not done, the newest first."""
    wanted = select(Upload).where(Upload.owner_id == owner, Upload.expires > now())
    return list(session.scalars(wanted.order_by(Upload.id.desc())))


def reserved(session: Session, owner: str) -> int:
    """Bytes that a user's uploads will take when they are done."""
    wanted = select(func.coalesce(func.sum(Upload.length), 0))
    return session.scalar(wanted.where(Upload.owner_id == owner, Upload.expires > now())) or 0
