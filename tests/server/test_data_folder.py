"""The data folder: held by one server at a time, and refused without a trace."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from server.data_folder import FOLDERS, DataFolder, DataFolderError
from server.hub import Hub
from server.settings import LEDGER, Settings
from tests.server.clients import client


def refused(path: Path) -> str:
    """The one line that says why."""
    with pytest.raises(DataFolderError) as raised:
        DataFolder(path)
    assert str(raised.value).count("\n") == 0 and str(path) in str(raised.value)
    return str(raised.value)


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    folder.chmod(0o500)
    yield
    folder.chmod(0o700)


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_new_folder_has_a_place_for_everything(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "new" / "data")

    assert {file.name for file in folder.path.iterdir()} == {*FOLDERS, ".lock"}
    folder.close()


def test_a_folder_is_held_until_it_is_closed(tmp_path: Path) -> None:
    first = DataFolder(tmp_path)

    assert "in use by another server; stop it, or give another --data" in refused(tmp_path)
    first.close()
    DataFolder(tmp_path).close()


def test_what_is_there_stays(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")

    DataFolder(tmp_path).close()

    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_file_in_place_of_the_folder(tmp_path: Path) -> None:
    path = tmp_path / "data"
    path.write_text("a letter")

    assert "cannot be written" in refused(path)
    assert "cannot be written" in refused(path / "deeper")
    assert path.read_text() == "a letter"


def test_a_file_in_place_of_one_of_its_folders_leaves_nothing_held(tmp_path: Path) -> None:
    (tmp_path / "blobs").write_text("a letter")
    before = descriptors()

    assert "cannot be written" in refused(tmp_path)
    assert "cannot be written" in refused(tmp_path)  # not: in use
    assert descriptors() == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_only_be_read(tmp_path: Path) -> None:
    with read_only(tmp_path):
        assert "cannot be written: Permission denied" in refused(tmp_path / "data")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="there is no such file system here")
def test_a_file_system_that_takes_no_files() -> None:
    assert "cannot be written" in refused(Path("/proc/hide"))


def test_nothing_is_made_beside_another_programs_database(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / LEDGER)) as opened:
        opened.execute("CREATE TABLE recipes (name TEXT)")
    before = (tmp_path / LEDGER).read_bytes()

    assert "another program" in refused(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [LEDGER]
    assert (tmp_path / LEDGER).read_bytes() == before


def test_a_start_that_fails_lets_go_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "growing" / "no file.rrd").mkdir(parents=True)

    with pytest.raises(OSError, match="no file"), client(tmp_path):
        pass

    DataFolder(tmp_path).close()


def test_a_hub_that_cannot_open_its_ledger_lets_go_of_the_folder(tmp_path: Path) -> None:
    hub = Hub.opened(Settings(data=tmp_path, workers=0))
    hub.database.close()
    hub.folder.close()
    before = descriptors()
    (tmp_path / LEDGER).write_bytes(b"damaged" * 1000)

    for _ in range(2):
        with pytest.raises(DataFolderError, match="cannot be read as a ledger"):
            Hub.opened(Settings(data=tmp_path, workers=0))

    assert descriptors() == before
