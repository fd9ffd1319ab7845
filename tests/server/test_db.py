"""The database file: how it is opened, read and written, and when it is refused."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from server import db, policies
from server.db import Database, LedgerError
from tests.server import ledgers
from workers.protocol import BuiltInPolicy


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


def register(database: Database, name: str) -> int:
    """The number that a policy's next version gets: read first, written then."""
    with database.writing() as session:
        return policies.register(session, name, BuiltInPolicy(name="noop")).number


@pytest.mark.parametrize(
    ("pragma", "value"),
    [("journal_mode", "wal"), ("synchronous", 2), ("foreign_keys", 1), ("recursive_triggers", 1)],
)
def test_every_connection_is_safe(database: Database, pragma: str, value: object) -> None:
    with database.reading() as reading, database.writing() as writing:
        for session in (reading, writing):
            assert session.scalar(text(f"PRAGMA {pragma}")) == value


def test_a_closed_ledger_is_one_file(database: Database, tmp_path: Path) -> None:
    register(database, "mine")
    database.close()

    assert [file.name for file in tmp_path.iterdir()] == ["ledger.sqlite3"]


def test_what_was_committed_outlives_a_crash(database: Database, tmp_path: Path) -> None:
    """The files as a power cut leaves them: the log was not merged into the database."""
    register(database, "mine")
    (tmp_path / "after").mkdir()
    for file in tmp_path.glob("ledger.sqlite3*"):
        if not file.name.endswith("-shm"):
            (tmp_path / "after" / file.name).write_bytes(file.read_bytes())

    with closing(Database(tmp_path / "after" / "ledger.sqlite3")) as recovered:
        assert register(recovered, "mine") == 2


def everything(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def corrupt(path: Path) -> None:
    path.write_bytes(b"not a database, but long enough " * 200)


def cut_short(path: Path) -> None:
    ledgers.opened(path.parent).close()
    path.write_bytes(path.read_bytes()[:5000])


def foreign(path: Path) -> None:
    with closing(sqlite3.connect(path)) as opened:
        opened.execute("CREATE TABLE recipes (name TEXT)")


def foreign_with_a_log(path: Path) -> None:
    with closing(sqlite3.connect(path)) as opened:
        opened.execute("PRAGMA journal_mode = WAL")
        opened.execute("CREATE TABLE recipes (name TEXT)")


def newer(path: Path) -> None:
    ledgers.opened(path.parent).close()
    with closing(sqlite3.connect(path)) as opened:
        opened.execute("UPDATE alembic_version SET version_num = '9999'")
        opened.commit()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (corrupt, "cannot be read as a ledger"),
        (cut_short, "damaged|cannot be read as a ledger"),
        (foreign, "another program"),
        (foreign_with_a_log, "another program"),
        (newer, "newer version .revision 9999"),
        (Path.mkdir, "cannot be read as a ledger"),
    ],
)
def test_a_file_that_is_no_ledger_is_left_as_it_is(tmp_path: Path, make, message: str) -> None:
    path = tmp_path / "ledger.sqlite3"
    make(path)
    before = everything(tmp_path) if path.is_file() else {}

    with pytest.raises(LedgerError, match=message) as refused:
        Database(path)

    assert str(refused.value).count("\n") == 0 and str(path) in str(refused.value)
    assert not path.is_file() or everything(tmp_path) == before


def test_looking_for_damage_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(db, "CHECKED_FOR", -1.0)
    path = tmp_path / "ledger.sqlite3"
    ledgers.opened(tmp_path).close()
    with closing(sqlite3.connect(path)) as opened, opened:  # enough for a look at the time
        opened.execute(
            "WITH RECURSIVE n(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM n WHERE n < 30000) "
            "INSERT INTO blobs SELECT 'blob' || n, n, '', '2026-01-01' FROM n"
        )

    Database(path).close()


def test_an_empty_file_becomes_a_ledger(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite3").touch()

    with closing(Database(tmp_path / "ledger.sqlite3")) as opened:
        assert register(opened, "mine") == 1


def test_a_ledger_that_another_program_holds_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(db, "BUSY_TIMEOUT", 0.1)
    path = tmp_path / "ledger.sqlite3"
    ledgers.opened(tmp_path).close()

    with closing(sqlite3.connect(path, isolation_level=None)) as holder:
        holder.execute("BEGIN IMMEDIATE")
        with pytest.raises(LedgerError, match="cannot be written: database is locked") as refused:
            Database(path)

    assert str(refused.value).count("\n") == 0


def test_a_folder_with_a_percent_sign_and_a_space(tmp_path: Path) -> None:
    folder = tmp_path / "50 %41 of it?"
    folder.mkdir()

    ledgers.opened(folder).close()

    assert [file.name for file in folder.iterdir()] == ["ledger.sqlite3"]
