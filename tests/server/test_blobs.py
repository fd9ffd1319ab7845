import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from server.blobs import Blobs


def test_only_half_written_files_are_cleared(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "blobs")
    whole = blobs.put(b"whole")
    (blobs.folder / ".half.0123.part").write_bytes(b"ha")

    blobs.clear_parts()

    assert [file for file in blobs.folder.rglob("*") if file.is_file()] == [blobs.path(whole)]


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Files may have so many bytes; more is answered as a full disk answers."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_what_found_no_room_leaves_nothing_and_may_come_again(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "blobs")

    with room_for(1000), pytest.raises(OSError):
        blobs.put(b"x" * 2000)

    assert list(blobs.folder.iterdir()) == []
    assert blobs.holds(blobs.put(b"x" * 2000))
