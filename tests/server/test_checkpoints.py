"""Checkpoints on their way in: what is refused while they come, and what is left of them."""

import asyncio
import errno
import hashlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from server import checkpoints
from server.blobs import Blobs
from server.checkpoints import Received, header_of, receive, receiving
from server.problems import Problem
from tests.workers import checkpoint_files


def received(
    pieces: list[bytes],
    path: Path,
    *,
    limit: int = 100,
    has_room: Callable[[], bool] = lambda: True,
    seconds: float = 0.0,
) -> Received:
    async def coming() -> AsyncIterator[bytes]:
        for piece in pieces:
            yield piece
            await asyncio.sleep(seconds)

    return asyncio.run(receive(coming(), path, limit=limit, has_room=has_room))


def test_what_comes_is_written_and_hashed(tmp_path: Path) -> None:
    found = received([b"wei", b"", b"ghts"], tmp_path / "a")

    assert found == (tmp_path / "a", hashlib.sha256(b"weights").hexdigest(), 7)
    assert found.path.read_bytes() == b"weights"


def test_the_limit_itself_is_taken_and_a_byte_more_is_not(tmp_path: Path) -> None:
    assert received([b"12", b"34"], tmp_path / "a", limit=4).size == 4

    with pytest.raises(Problem, match="at most 4 bytes") as raised:
        received([b"12", b"345"], tmp_path / "b", limit=4)
    assert raised.value.status == 413


def test_an_empty_body_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Problem, match="body: is empty") as raised:
        received([b""], tmp_path / "a")
    assert raised.value.status == 422


def test_a_full_disk_is_no_fault_of_ours(tmp_path: Path) -> None:
    with pytest.raises(Problem, match="disk is almost full") as raised:
        received([b"12"], tmp_path / "a", has_room=lambda: False)
    assert raised.value.status == 507


def test_a_disk_that_fills_up_in_between_is_told_as_such(tmp_path: Path) -> None:
    async def coming() -> AsyncIterator[bytes]:
        yield b"12"
        raise OSError(errno.ENOSPC, "No space left on device")  # as writing would

    with pytest.raises(Problem, match="disk is almost full") as raised:
        asyncio.run(receive(coming(), tmp_path / "a", limit=100, has_room=lambda: True))
    assert raised.value.status == 507


def test_an_upload_that_stands_still_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoints, "STILL_LIMIT", 0.1)

    with pytest.raises(Problem, match=r"No byte came for 0\.1 s") as raised:
        received([b"12"], tmp_path / "a", seconds=5)
    assert raised.value.status == 408
    assert received([b"12"] * 4, tmp_path / "b", seconds=0.05).size == 8


def test_nothing_is_left_of_an_upload_that_is_not_taken(tmp_path: Path) -> None:
    store = Blobs(tmp_path)

    with receiving(store) as path:
        path.write_bytes(b"weights")

    assert list(tmp_path.rglob("*")) == []


def test_what_a_killed_server_was_receiving_is_cleared(tmp_path: Path) -> None:
    store = Blobs(tmp_path)
    store.new_part().write_bytes(b"wei")

    store.clear_parts()

    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrong", checkpoint_files.WRONG)
def test_what_is_no_checkpoint_is_refused_by_its_header(tmp_path: Path, wrong: str) -> None:
    content, message = checkpoint_files.WRONG[wrong]
    path = tmp_path / "a"
    path.write_bytes(content)

    with pytest.raises(Problem, match=f"body: is no checkpoint: .*{message}"):
        header_of(Received(path, "", len(content)))


def test_a_header_tells_the_model(tmp_path: Path) -> None:
    path = checkpoint_files.written(tmp_path / "a", name="seek-small")

    assert header_of(Received(path, "", 0)).config.name == "seek-small"
