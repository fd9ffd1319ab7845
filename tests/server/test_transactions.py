"""How the ledger is read and written, whichever database keeps it."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import func, select

from server import policies
from server.db import Database
from server.models import Policy
from tests.server import ledgers
from workers.protocol import BuiltInPolicy

pytestmark = pytest.mark.usefixtures("on_each_database")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


def register(database: Database, name: str) -> int:
    """The number that a policy's next version gets: read first, written then."""
    with database.writing() as session:
        return policies.register(session, name, BuiltInPolicy(name="noop")).number


def test_writers_that_read_first_wait_for_each_other(database: Database) -> None:
    failures: list[BaseException] = []
    numbers: list[int] = []

    def many() -> None:
        try:
            numbers.extend(register(database, "shared") for _ in range(15))
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=many) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert failures == []
    assert sorted(numbers) == list(range(1, 61))


def test_a_reader_sees_one_state_and_hinders_no_writer(database: Database) -> None:
    count = select(func.count()).select_from(Policy)
    with database.reading() as session:
        before = session.scalar(count)
        register(database, "added meanwhile")

        assert session.scalar(count) == before
    with database.reading() as session:
        assert session.scalar(count) == (before or 0) + 1


def test_a_block_that_raises_writes_nothing(database: Database) -> None:
    rung: list[int] = []
    database.after_commit = lambda: rung.append(1)

    with pytest.raises(RuntimeError), database.writing() as session:
        policies.register(session, "mine", BuiltInPolicy(name="noop"))
        raise RuntimeError

    with database.reading() as session:
        assert session.scalar(select(Policy).where(Policy.name == "mine")) is None
    assert rung == []


def test_every_committed_write_is_told(database: Database) -> None:
    rung: list[int] = []
    database.after_commit = lambda: rung.append(1)

    register(database, "mine")

    assert rung == [1]
