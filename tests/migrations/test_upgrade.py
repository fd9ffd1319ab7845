"""A ledger that the first version made, with rows in every table, comes up to date.

`ledger_0001.sql` is a dump of what that version's own code wrote: a completed evaluation, one under
way with an open attempt, an alarm.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine
from sqlalchemy.exc import IntegrityError

from server.db import Database, LedgerError, known_revisions, migrate
from server.read_only import ReadOnlyFolder
from server.settings import LEDGER
from server.verification.ledger import Verifier
from tests.migrations.test_migrations import execute
from tests.server.clients import API, TestClient, client

FIRST = (Path(__file__).with_name("ledger_0001.sql")).read_text()
Rows = dict[str, list[dict[str, Any]]]


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A data folder with the first version's ledger."""
    with closing(sqlite3.connect(tmp_path / LEDGER)) as opened:
        opened.executescript(FIRST)
    return tmp_path


@pytest.fixture
def upgraded(old: Path) -> Iterator[Database]:
    database = Database(old / LEDGER)
    yield database
    database.close()


def rows_of(folder: Path) -> Rows:
    """Every row of every table, in order."""
    with closing(sqlite3.connect(folder / LEDGER)) as opened:
        opened.row_factory = sqlite3.Row
        query = "SELECT name FROM sqlite_master WHERE type = 'table'"
        names = [row["name"] for row in opened.execute(query)]
        found = {}
        for name in names:
            rows = [dict(row) for row in opened.execute(f"SELECT * FROM {name}")]
            found[name] = sorted(rows, key=lambda row: str(sorted(row.items(), key=str)))
        return found


def schema_of(folder: Path) -> dict[str, str]:
    """The statements that made tables, indexes and triggers, by name."""
    query = "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL"
    with closing(sqlite3.connect(folder / LEDGER)) as opened:
        return dict(opened.execute(query).fetchall())


def test_the_first_ledger_has_rows_in_every_table(old: Path) -> None:
    rows = rows_of(old)

    assert rows.pop("alembic_version") == [{"version_num": "0001"}]
    assert len(rows) == 13  # SQLite's own counters as well
    assert all(rows.values()), rows.keys()


def test_it_comes_up_with_the_same_rows(old: Path) -> None:
    before = rows_of(old)

    Database(old / LEDGER).close()

    after = rows_of(old)
    assert after.pop("alembic_version") == [{"version_num": known_revisions()[0]}]
    for name in before.keys() - {"alembic_version", "sqlite_sequence"}:
        columns = before[name][0].keys()
        kept = [{column: row[column] for column in columns} for row in after[name]]
        assert sorted(kept, key=str) == sorted(before[name], key=str), name
        added = {row[one] for row in after[name] for one in row.keys() - columns}
        assert added <= {None}, name  # nobody invents what was not known then


def test_what_was_guarded_is_guarded(upgraded: Database) -> None:
    for statement, message in (
        ("UPDATE episodes SET success = 1 WHERE state = 'final'", "immutable"),
        ("DELETE FROM decisions", "immutable"),
        ("UPDATE evaluations SET state = 'queued' WHERE state = 'completed'", "do not move so"),
        ("DELETE FROM events", "immutable"),
    ):
        with pytest.raises(IntegrityError, match=message):
            execute(upgraded, statement)


def test_no_trigger_or_index_is_lost(old: Path) -> None:
    before = schema_of(old)

    Database(old / LEDGER).close()

    assert before.keys() <= schema_of(old).keys()


def test_it_is_whole(upgraded: Database) -> None:
    with closing(sqlite3.connect(upgraded.path)) as opened:
        assert opened.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert opened.execute("PRAGMA foreign_key_check").fetchall() == []


def test_its_digests_and_verdicts_are_recomputed(old: Path, upgraded: Database) -> None:
    upgraded.close()

    with ReadOnlyFolder.opened(old) as folder:
        found = Verifier(folder, sample=0).verify()

    assert {one.what for one in found.mismatches} == {"file"}  # the dump has no thumbnails
    assert found.episodes == 4


def test_a_server_goes_on_with_it(old: Path) -> None:
    found: TestClient
    with client(old) as found:
        evaluations = found.get(f"{API}/evaluations").json()["items"]
        episodes = found.get(f"{API}/episodes", params={"state": "final"}).json()["items"]

    assert [one["policy"] for one in evaluations] == ["mine", "expert"]
    assert evaluations[1]["state"] == "completed"
    assert [one["verdicts"]["success"]["successes"] for one in evaluations] == [0, 2]
    assert len(episodes) == 4


def test_step_by_step_it_comes_to_the_same(tmp_path: Path, old: Path) -> None:
    whole = tmp_path / "whole"
    whole.mkdir()
    (whole / LEDGER).write_bytes((old / LEDGER).read_bytes())
    Database(whole / LEDGER).close()

    engine = create_engine(f"sqlite:///{old / LEDGER}")
    for revision in known_revisions()[-2::-1]:
        migrate(engine, revision)
    engine.dispose()

    assert schema_of(old) == schema_of(whole)
    assert rows_of(old) == rows_of(whole)


def test_a_migration_that_fails_leaves_it_as_it_was(old: Path) -> None:
    """What the last migration makes is there already; those before it had done their work."""
    with closing(sqlite3.connect(old / LEDGER)) as opened:
        opened.execute("CREATE TABLE removals (in_the_way TEXT)")
    before = rows_of(old), schema_of(old)

    with pytest.raises(LedgerError, match=r"left as it was: table removals already exists"):
        Database(old / LEDGER)

    assert (rows_of(old), schema_of(old)) == before
    with closing(sqlite3.connect(old / LEDGER)) as opened:
        opened.execute("DROP TABLE removals")
    Database(old / LEDGER).close()
    assert rows_of(old)["alembic_version"] == [{"version_num": known_revisions()[0]}]
