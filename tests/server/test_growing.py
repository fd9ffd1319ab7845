"""Recordings that are watched while they come in."""

import asyncio
import hashlib
from collections.abc import AsyncIterator, Iterable
from pathlib import Path

import pytest

from server import growing
from server.blobs import Blobs
from server.growing import BrokenOff, Growing, GrowingRecordings, TooLarge

PIECES = [b"RRF2", b"", b"frame one", b"frame two"]
WHOLE = b"".join(PIECES)


@pytest.fixture
def recordings(tmp_path: Path) -> GrowingRecordings:
    found = GrowingRecordings(tmp_path / "growing")
    found.clear()
    return found


async def slowly(
    pieces: Iterable[bytes], fails: type[Exception] | None = None
) -> AsyncIterator[bytes]:
    for piece in pieces:
        await asyncio.sleep(0.001)
        yield piece
    if fails:
        raise fails("gone")


async def read(recording: Growing) -> bytes:
    return b"".join([piece async for piece in recording.follow()])


def test_a_reader_follows_the_writer(recordings: GrowingRecordings) -> None:
    async def scene() -> list[bytes]:
        recording, seen = recordings.open("ep_1"), []
        sent: asyncio.Queue[bytes | None] = asyncio.Queue()

        async def arriving() -> AsyncIterator[bytes]:
            while piece := await sent.get():
                yield piece

        writer = asyncio.create_task(recording.fill(arriving()))
        reader = recording.follow()
        for piece in (b"one", b"two"):  # each is read before the next is sent
            await sent.put(piece)
            seen.append(await asyncio.wait_for(anext(reader), 5))
        await sent.put(None)
        await writer
        seen.append(b"".join([piece async for piece in reader]))
        return seen

    assert asyncio.run(scene()) == [b"one", b"two", b""]


def test_every_reader_gets_everything_whenever_it_joins(recordings: GrowingRecordings) -> None:
    async def scene() -> list[bytes]:
        recording = recordings.open("ep_1")
        writer = asyncio.create_task(recording.fill(slowly(PIECES)))
        readers = [asyncio.create_task(read(recording))]
        while recording.size < 4:
            await asyncio.sleep(0.001)
        readers += [asyncio.create_task(read(recording)) for _ in range(3)]
        await writer
        readers.append(asyncio.create_task(read(recording)))
        return await asyncio.gather(*readers)

    assert asyncio.run(scene()) == [WHOLE] * 5


def test_the_writer_learns_what_was_kept(recordings: GrowingRecordings) -> None:
    stored = asyncio.run(recordings.open("ep_1").fill(slowly(PIECES)))

    assert (stored.size, stored.sha256) == (len(WHOLE), hashlib.sha256(WHOLE).hexdigest())


def test_a_writer_that_breaks_off_is_told_to_its_readers_after_what_came(
    recordings: GrowingRecordings,
) -> None:
    came: list[bytes] = []

    async def scene() -> None:
        recording = recordings.open("ep_1")
        with pytest.raises(ConnectionError):
            await recording.fill(slowly(PIECES[:3], ConnectionError))
        async for piece in recording.follow():
            came.append(piece)

    with pytest.raises(BrokenOff):
        asyncio.run(scene())
    assert b"".join(came) == b"".join(PIECES[:3])


def test_too_large_a_recording_is_refused(
    recordings: GrowingRecordings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growing, "MOST", 10)
    recording = recordings.open("ep_1")

    with pytest.raises(TooLarge, match="at most 10 bytes"):
        asyncio.run(recording.fill(slowly(PIECES)))

    assert recording.done
    assert recording.path.stat().st_size <= 10


def test_the_file_may_move_while_it_is_read(recordings: GrowingRecordings, tmp_path: Path) -> None:
    store = Blobs(tmp_path / "blobs")

    async def scene() -> bytes:
        recording = recordings.open("ep_1")
        writer = asyncio.create_task(recording.fill(slowly(PIECES)))
        reader = recording.follow()
        first = await anext(reader)
        stored = await writer
        store.take(recording.path, stored.sha256)
        recordings.forget("ep_1")
        return first + b"".join([piece async for piece in reader])

    assert asyncio.run(scene()) == WHOLE


def test_a_reader_may_join_after_the_file_moved(
    recordings: GrowingRecordings, tmp_path: Path
) -> None:
    """The recording is there already, the verdict of its episode is not."""
    store = Blobs(tmp_path / "blobs")

    async def scene() -> bytes:
        recording = recordings.open("ep_1")
        stored = await recording.fill(slowly(PIECES))
        recording.place = store.path(stored.sha256)
        store.take(recording.path, stored.sha256)
        found = recordings.get("ep_1")
        assert found is recording
        return await read(found)

    assert asyncio.run(scene()) == WHOLE


def test_forgetting_a_recording_keeps_what_moved(
    recordings: GrowingRecordings, tmp_path: Path
) -> None:
    store = Blobs(tmp_path / "blobs")
    recording = recordings.open("ep_1")
    stored = asyncio.run(recording.fill(slowly(PIECES)))
    recording.place = store.path(stored.sha256)
    store.take(recording.path, stored.sha256)

    recordings.forget("ep_1")

    assert recordings.get("ep_1") is None
    assert store.path(stored.sha256).read_bytes() == WHOLE


def test_forgetting_a_recording_removes_its_file(recordings: GrowingRecordings) -> None:
    asyncio.run(recordings.open("ep_1").fill(slowly(PIECES)))

    recordings.forget("ep_1")
    recordings.forget("ep_1")

    assert list(recordings.folder.iterdir()) == []


def test_a_second_recording_of_an_episode_replaces_the_first(recordings: GrowingRecordings) -> None:
    first = recordings.open("ep_1")
    second = recordings.open("ep_1")

    recordings.forget("ep_1", first)

    assert recordings.get("ep_1") is second
    assert list(recordings.folder.iterdir()) == [second.path]


def test_what_a_stopped_server_left_is_removed(recordings: GrowingRecordings) -> None:
    recordings.open("ep_1")

    GrowingRecordings(recordings.folder).clear()

    assert list(recordings.folder.iterdir()) == []
