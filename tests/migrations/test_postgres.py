"""Every migration, up and down, in a real PostgreSQL."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import inspect, text
from sqlalchemy.exc import IntegrityError

from server.db import Database, migrate, migrations
from server.models import Base
from tests.migrations.test_migrations import (
    check_snapshot_of_before,
    fill,
    objects,
    snapshot_of_before,
)
from tests.server import ledgers, postgres

pytestmark = postgres.needs_postgres

OURS = "current_schema()::regnamespace"
KINDS = {
    "table": f"SELECT relname FROM pg_class WHERE relkind = 'r' AND relnamespace = {OURS}",
    "index": "SELECT indexname FROM pg_indexes WHERE schemaname = current_schema()",
    "trigger": "SELECT tgname FROM pg_trigger WHERE NOT tgisinternal",
    "function": f"SELECT proname FROM pg_proc WHERE pronamespace = {OURS}",
    "sequence": f"SELECT relname FROM pg_class WHERE relkind = 'S' AND relnamespace = {OURS}",
}


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = Database(ledgers.laid_in_postgres(tmp_path))
    yield opened
    opened.close()


def down(database: Database) -> None:
    with database.engine.execution_options(writes=True).begin() as connection:
        command.downgrade(migrations(connection), "base")


def everything(database: Database) -> dict[str, set[str]]:
    with database.engine.connect() as connection:
        found = {kind: set(connection.scalars(text(wanted))) for kind, wanted in KINDS.items()}
    return {
        kind: {name for name in names if "alembic" not in name} for kind, names in found.items()
    }


def test_up_from_nothing_equals_the_models(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_server_default": True})

        assert compare_metadata(context, Base.metadata) == []


def test_constraints_equal_the_models(database: Database) -> None:
    found = inspect(database.engine)

    for name, table in Base.metadata.tables.items():
        wanted = {one.name for one in table.constraints if "Check" in type(one).__name__}
        assert {one["name"] for one in found.get_check_constraints(name)} == wanted


def test_it_has_every_trigger_that_sqlite_has(database: Database, tmp_path: Path) -> None:
    file = ledgers.opened(tmp_path)
    wanted = objects(file, "trigger")
    file.close()

    found = everything(database)

    assert len(wanted) > 20
    assert wanted <= found["trigger"] == found["function"]


def test_up_and_down_with_every_table_full(database: Database, tmp_path: Path) -> None:
    before = everything(database)
    fill(database, tmp_path)
    with database.engine.connect() as connection:
        for name in Base.metadata.tables:
            assert connection.scalar(text(f"SELECT count(*) FROM {name}")), name

    down(database)
    assert everything(database) == {kind: set() for kind in KINDS}

    migrate(database.engine)
    assert everything(database) == before


def test_a_snapshot_of_before_is_of_suite_hide(database: Database) -> None:
    snapshot_of_before(database)

    migrate(database.engine)

    check_snapshot_of_before(database)


@pytest.mark.parametrize("table", ["episodes", "decisions", "events", "blobs", "audit_entries"])
def test_a_table_is_not_emptied_past_its_triggers(
    database: Database, tmp_path: Path, table: str
) -> None:
    fill(database, tmp_path)

    with (
        pytest.raises(IntegrityError, match="immutable"),
        database.engine.execution_options(writes=True).begin() as connection,
    ):
        connection.execute(text(f"TRUNCATE {table} CASCADE"))
