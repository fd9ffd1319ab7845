"""What is PostgreSQL's own: addresses, the right to write, a server's claim, sizes, text."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, select, text
from sqlalchemy.exc import DBAPIError

from server import policies
from server import postgres as dialect
from server.db import Database, LedgerError
from server.models import Blob, Policy
from tests.server import ledgers, postgres
from tests.server.clients import API, client, create
from workers.protocol import BuiltInPolicy

pytestmark = postgres.needs_postgres


@pytest.fixture
def address(tmp_path: Path) -> str:
    """Of a new ledger."""
    return ledgers.laid_in_postgres(tmp_path)


@pytest.fixture
def database(address: str) -> Iterator[Database]:
    with closing(Database(address)) as opened:
        yield opened


def new_name(folder: Path) -> str:
    return f"db_{abs(hash(folder)):x}"


def execute(database: Database, statement: str) -> None:
    with database.writing() as session:
        session.execute(text(statement))


def cut_connections(database: Database) -> None:
    """What a restart of PostgreSQL does to those who are connected; they are gone then."""
    ended = "SELECT pg_terminate_backend(pid, 20000) FROM pg_stat_activity"
    execute(database, f"{ended} WHERE datname = current_database() AND pid <> pg_backend_pid()")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("mysql://me:secret@host/name", "should be like postgresql"),
        ("postgresql+psycopg://me:secret@host", "should be like postgresql"),
        ("no address: secret", "should be like postgresql"),
        ("postgresql+psycopg://me:secret@127.0.0.1:1/name", "cannot be used: .*refused"),
    ],
)
def test_a_wrong_address_is_one_line_without_its_password(wrong: str, message: str) -> None:
    with pytest.raises(LedgerError, match=message) as refused:
        Database(wrong)

    assert "secret" not in str(refused.value) and "\n" not in str(refused.value)


def test_other_programs_databases_and_newer_ledgers_are_left_alone(
    address: str, tmp_path: Path
) -> None:
    other = Database(postgres.create(new_name(tmp_path)))
    execute(other, "DROP TABLE alembic_version")
    other.close()
    with closing(Database(address)) as ledger:
        execute(ledger, "UPDATE alembic_version SET version_num = '9999'")

    with pytest.raises(LedgerError, match="another program"):
        Database(str(other.engine.url))
    with pytest.raises(LedgerError, match=r"newer version .revision 9999"):
        Database(address)


def test_text_must_be_kept_as_utf8(tmp_path: Path) -> None:
    with pytest.raises(LedgerError, match="keeps text as LATIN1"):
        Database(postgres.create(new_name(tmp_path), encoding="LATIN1"))


def test_one_server_at_a_time_has_the_ledger(address: str) -> None:
    with closing(Database(address)) as first, closing(Database(address)) as second:
        first.claim()
        with pytest.raises(LedgerError, match="in use by another server"):
            second.claim()
        first.close()

        second.claim()


def test_a_server_that_lost_its_connection_claims_the_ledger_anew(address: str) -> None:
    with closing(Database(address)) as first, closing(Database(address)) as second:
        first.claim()
        cut_connections(second)

        first.claim()

        with pytest.raises(LedgerError, match="in use by another server"):
            second.claim()


def test_a_server_that_was_too_late_is_told(address: str) -> None:
    with closing(Database(address)) as first, closing(Database(address)) as second:
        first.claim()
        cut_connections(second)
        second.claim()

        with pytest.raises(LedgerError, match="in use by another server"):
            first.claim()


def test_a_transaction_that_reads_cannot_write(database: Database) -> None:
    with pytest.raises(DBAPIError, match="read-only"), database.reading() as session:
        session.execute(text("DELETE FROM uploads"))


def test_a_writer_gives_up_on_one_that_hangs(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialect, "LOCK_TIMEOUT", 200)

    with database.writing() as session:
        session.execute(text("SELECT 1"))
        began = time.monotonic()
        with pytest.raises(DBAPIError, match="lock timeout"):
            execute(database, "SELECT 1")

    assert time.monotonic() - began < 20
    execute(database, "SELECT 1")


def test_a_writer_that_died_holds_nobody_up(database: Database) -> None:
    inside, over = threading.Event(), threading.Event()

    def hold() -> None:
        with pytest.raises(DBAPIError), database.writing() as session:
            session.execute(text("SELECT 1"))
            inside.set()
            over.wait(20)
            session.execute(text("SELECT 1"))

    holder = threading.Thread(target=hold)
    holder.start()
    inside.wait(20)
    with database.engine.connect() as connection:
        connection.execute(
            text(
                "SELECT pg_terminate_backend(pid) FROM pg_locks "
                "WHERE locktype = 'advisory' AND pid <> pg_backend_pid()"
            )
        )

    execute(database, "SELECT 1")

    over.set()
    holder.join()


def test_sizes_beyond_two_gigabytes_and_their_sum(database: Database) -> None:
    with database.writing() as session:
        session.add_all(
            Blob(sha256=name * 64, size=3 * 2**30, media_type="text/plain") for name in "ab"
        )
    with database.reading() as session:
        total = session.scalar(select(func.sum(Blob.size)))
        mean = session.scalar(select(func.avg(Blob.size)))

    assert (total, type(total)) == (6 * 2**30, int)
    assert mean == 3 * 2**30


def test_text_with_a_nul_is_kept_but_for_it(database: Database) -> None:
    with database.writing() as session:
        policies.register(session, "mine\0", BuiltInPolicy(name="noop"))
    with database.reading() as session:
        names = set(session.scalars(select(Policy.name)))

    assert "mine\N{REPLACEMENT CHARACTER}" in names


def test_the_application_runs_on_it(tmp_path: Path, address: str) -> None:
    with client(tmp_path / "data", database=address) as app:
        evaluation = create(app)
        hub = app.app.state.hub
        with hub.database.writing() as session:
            while ledgers.play_shard(session, hub.blobs):
                pass

        found = app.get(f"{API}/evaluations/{evaluation['id']}").json()
        assert (found["state"], found["progress"]["final"]) == ("completed", 2)
        for path in ("policies", "evaluations", "leaderboard", "episodes", "health/ready"):
            assert app.get(f"{API}/{path}").status_code == 200, path
