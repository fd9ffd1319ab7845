"""Recordings of running episodes: they grow while a worker sends them, and are watched meanwhile.

One writer, any number of readers; each reader gets everything from the first byte, then waits
for more until the writer is done.
"""

import asyncio
import hashlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from workers.protocol import Stored

PIECE = 2**20  # bytes
MOST = 2**29  # bytes of one recording: 500 times what an episode takes


class TooLarge(ValueError):
    """A recording is larger than any episode's."""


class BrokenOff(Exception):
    """The writer ended before the recording did; a reader's connection is cut, not closed."""


class Growing:
    """One recording on its way in."""

    def __init__(self, path: Path):
        self.path = path
        self.place = path  # where it is, or will be, once it is complete
        self.size = 0  # bytes that are on disk
        self.done = False  # nothing more will come
        self.whole = False  # everything has come
        self._more = asyncio.Event()

    async def fill(self, pieces: AsyncIterator[bytes]) -> Stored:
        """Writes what comes; what it was in the end.

        Raises:
            TooLarge: it is more than MOST bytes.
        """
        digest = hashlib.sha256()
        try:
            with open(self.path, "wb", buffering=0) as file:
                async for piece in pieces:
                    if self.size + len(piece) > MOST:
                        raise TooLarge(f"A recording has at most {MOST} bytes.")
                    file.write(piece)
                    digest.update(piece)
                    self.size += len(piece)
                    self._tell()
            self.whole = True
            return Stored(sha256=digest.hexdigest(), size=self.size)
        finally:
            self.done = True
            self._tell()

    def _tell(self) -> None:
        self._more.set()
        self._more = asyncio.Event()

    async def follow(self) -> AsyncIterator[bytes]:
        """Everything from the first byte on, as it comes.

        Raises:
            BrokenOff: the recording will never be whole.
        """
        with self._opened() as file:  # stays open when the file moves to its place
            while True:
                more = self._more
                if piece := file.read(PIECE):
                    yield piece
                elif self.done and not self.whole:
                    raise BrokenOff("The recording broke off.")
                elif self.done:
                    return
                else:
                    await more.wait()

    def _opened(self) -> BinaryIO:
        try:
            return open(self.path, "rb")
        except FileNotFoundError:
            return open(self.place, "rb")


class GrowingRecordings:
    """The recordings on their way in, by episode."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._by_episode: dict[str, Growing] = {}

    def clear(self) -> None:
        """Removes what a stopped server left behind."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for file in self.folder.glob("*.rrd"):
            file.unlink()

    def open(self, episode: str) -> Growing:
        """A place for an episode's recording; a former one is forgotten."""
        growing = Growing(self.folder / f"{episode}.{uuid4().hex[:8]}.rrd")
        growing.path.touch()
        self._by_episode[episode] = growing
        return growing

    def get(self, episode: str) -> Growing | None:
        """The recording that is coming in or has just come in, if any."""
        return self._by_episode.get(episode)

    def forget(self, episode: str, growing: Growing | None = None) -> None:
        """Ends what is known of an episode's recording; a file that is still here goes."""
        known = self._by_episode.get(episode)
        if known is not None and growing in (None, known):
            del self._by_episode[episode]
        if gone := growing or known:
            gone.path.unlink(missing_ok=True)
