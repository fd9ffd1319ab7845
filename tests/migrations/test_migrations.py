"""Every migration, up and down, on real files."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import inspect, text
from sqlalchemy.exc import IntegrityError, OperationalError

from hide_tasks.contract import Failure
from server import (
    audit,
    batches,
    credentials,
    labels,
    lifecycle,
    policies,
    snapshots,
    uploads,
    users,
    webhooks,
)
from server.access import Principal, Role, Scope
from server.blobs import Blobs
from server.commit import commit
from server.db import Database, examine, known_revisions, migrate, migrations
from server.models import Attempt, Base, Removal, User
from server.schemas.episodes import LabelCreate
from server.states import WebhookEvent
from tests.server import ledgers


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = ledgers.opened(tmp_path)
    yield opened
    opened.close()


def down(database: Database, revision: str = "base") -> None:
    with database.engine.execution_options(writes=True).begin() as connection:
        command.downgrade(migrations(connection), revision)


def execute(database: Database, statement: str) -> None:
    with database.engine.execution_options(writes=True).begin() as connection:
        connection.execute(text(statement))


def objects(database: Database, kind: str) -> set[str]:
    """Names of the tables, indexes or triggers that the file holds, SQLite's own apart."""
    wanted = text("SELECT name FROM sqlite_master WHERE type = :kind AND name NOT LIKE 'sqlite_%'")
    with database.engine.connect() as connection:
        return set(connection.scalars(wanted, {"kind": kind})) - {"alembic_version"}


def principal_of(user: User) -> Principal:
    """The user, by whatever their role allows."""
    return Principal(user.id, user.name, Role.ADMIN, Role.ADMIN.scopes, via="local")


def fill(database: Database, folder: Path) -> None:
    """Rows in every table."""
    store = Blobs(folder / "blobs")
    id = ledgers.evaluated(database, store, episodes=1)
    with database.writing() as session:
        [episode, *_] = ledgers.episodes_of(session, id)
        attempt = session.query(Attempt).filter_by(shard_id=episode.shard_id).one()
        other = ledgers.result_of(lifecycle.spec_of(episode), Failure.OVERCOUNT)
        commit(session, store, attempt, episode, other)
        owner = users.register_owner(session)
        credentials.create_token(session, owner, "test", [Scope.READ])
        credentials.sign_in(session, owner)
        wanted = {"length": 7, "name": "mine", "description": "", "sha256": None}
        uploads.create(session, owner.id, **wanted)
        batches.begun(session, [{"policy": "noop"}], "key", owner.id)
        snapshots.keep(session, "{}", "test", owner=owner.id)
        mine = LabelCreate(label="odd")
        said = labels.add(session, episode, mine, principal_of(owner))
        labels.withdraw(session, said.id, principal_of(owner))
        audit.note(session, "test", "", principal=None)
        hook = webhooks.create(
            session, owner.id, url="https://x", events=list(WebhookEvent), everybodys=True,
            description="",
        )  # fmt: skip
        hook.after = 0
        webhooks.collect(session)
        session.add(Removal(sha256=episode.thumbnail, reason="test"))


def snapshot_of_before(database: Database) -> None:
    """A ledger as it was before there were several suites, with a snapshot in it."""
    down(database, "0011")
    execute(
        database,
        "INSERT INTO leaderboard_snapshots (number, sha256, content, split, note, created) "
        f"VALUES (3, '{'a' * 64}', '[]', 'val', 'kept', '2026-01-01 00:00:00')",
    )


def check_snapshot_of_before(database: Database) -> None:
    """It is of suite `hide`, the same otherwise, and never changes."""
    columns = "suite, number, sha256, content, split, note"
    with database.engine.connect() as connection:
        [row] = connection.execute(text(f"SELECT {columns} FROM leaderboard_snapshots")).all()
    assert tuple(row) == ("hide", 3, "a" * 64, "[]", "val", "kept")
    with pytest.raises(IntegrityError, match="snapshots are immutable"):
        execute(database, "UPDATE leaderboard_snapshots SET suite = 'hide-hard'")


def test_up_from_nothing_equals_the_models(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_server_default": True})

        assert compare_metadata(context, Base.metadata) == []


def test_constraints_equal_the_models(database: Database) -> None:
    """Alembic compares no CHECKs."""
    found = inspect(database.engine)

    for name, table in Base.metadata.tables.items():
        wanted = {one.name for one in table.constraints if "Check" in type(one).__name__}
        assert {one["name"] for one in found.get_check_constraints(name)} == wanted


def test_down_to_the_base_leaves_nothing(database: Database) -> None:
    down(database)

    assert [objects(database, kind) for kind in ("table", "index", "trigger")] == [set()] * 3


def test_up_again_makes_the_same(database: Database) -> None:
    kinds = ("table", "index", "trigger")
    before = [objects(database, kind) for kind in kinds]

    down(database)
    migrate(database.engine)

    assert [objects(database, kind) for kind in kinds] == before
    assert len(before[2]) > 20


def test_a_snapshot_of_before_is_of_suite_hide(database: Database) -> None:
    snapshot_of_before(database)

    migrate(database.engine)

    check_snapshot_of_before(database)


def test_triggers_guard_after_a_round_trip(database: Database, tmp_path: Path) -> None:
    down(database)
    migrate(database.engine)
    with database.writing() as session:
        policies.register_builtin(session)
    ledgers.evaluated(database, Blobs(tmp_path / "blobs"), episodes=1)

    with pytest.raises(IntegrityError, match="evaluations do not move so"):
        execute(database, "UPDATE evaluations SET state = 'running'")
    with pytest.raises(IntegrityError, match="a final episode is immutable"):
        execute(database, "DELETE FROM episodes")


def test_every_table_may_be_full_on_the_way_down_and_up(database: Database, tmp_path: Path) -> None:
    fill(database, tmp_path)
    with database.engine.connect() as connection:
        rows = {
            name: connection.scalar(text(f"SELECT count(*) FROM {name}"))
            for name in Base.metadata.tables
        }
    assert all(rows.values()), rows

    down(database)
    migrate(database.engine)

    with database.engine.connect() as connection:
        assert not any(connection.scalar(text(f"SELECT count(*) FROM {name}")) for name in rows)
        assert connection.execute(text("PRAGMA foreign_key_check")).all() == []


def test_a_ledger_that_is_up_to_date_is_left_alone(database: Database, tmp_path: Path) -> None:
    fill(database, tmp_path)
    database.close()
    before = database.path.read_bytes()

    Database(database.path).close()

    assert database.path.read_bytes() == before


def test_a_migration_that_fails_leaves_nothing_half_done(database: Database) -> None:
    down(database)
    execute(database, "CREATE TABLE shards (id TEXT)")  # in the way, half-way through

    with pytest.raises(OperationalError, match="shards already exists"):
        migrate(database.engine)

    assert objects(database, "table") == {"shards"}


def test_revisions_are_numbered_in_a_line() -> None:
    revisions = known_revisions()

    assert list(revisions) == [f"{number:04d}" for number in range(len(revisions), 0, -1)]


def test_a_file_that_is_not_there_may_become_a_ledger(tmp_path: Path) -> None:
    examine(tmp_path / "ledger.sqlite3")

    assert list(tmp_path.iterdir()) == []
