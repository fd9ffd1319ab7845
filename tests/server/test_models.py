"""What the tables themselves refuse, whoever asks; tried with plain SQL."""

from collections.abc import Iterator

import pytest
from sqlalchemy import Connection, select, text
from sqlalchemy.exc import IntegrityError

from hide_tasks.contract import Failure
from server import batches, lifecycle, snapshots, users
from server.blobs import Blobs
from server.commit import commit
from server.models import Attempt, Base, EpisodeLabel, new_id
from tests.server import ledgers

pytestmark = pytest.mark.usefixtures("on_each_database")


@pytest.fixture(scope="module")
def ledger(on_each_database: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Connection]:
    """A final episode with an alarm, and a leased shard with an episode that runs."""
    folder = tmp_path_factory.mktemp("models")
    database, store = ledgers.opened(folder, on_each_database), Blobs(folder / "blobs")
    id = ledgers.evaluated(database, store, tasks=["search_drawer"], episodes=1)
    with database.writing() as session:
        [episode] = ledgers.episodes_of(session, id)
        attempt = session.scalars(select(Attempt)).one()
        other = ledgers.result_of(lifecycle.spec_of(episode), Failure.OVERCOUNT)
        commit(session, store, attempt, episode, other)
        owner = users.register_owner(session)
        batches.begun(session, [{"policy": "noop"}], None, owner.id)
        snapshots.keep(session, "{}", "test")
        session.add(EpisodeLabel(id=new_id("la"), episode_id=episode.id, author_id=owner.id))
        ledgers.created(session, tasks=["search_drawer"], episodes=1)
        found = ledgers.leased(session)
        assert found is not None
        lifecycle.begin(session, found[0], found[1].episodes[0])
    with database.engine.execution_options(writes=True).connect() as connection:
        yield connection
    database.close()


@pytest.fixture
def connection(ledger: Connection) -> Iterator[Connection]:
    yield ledger
    ledger.rollback()


FINAL = "(SELECT id FROM episodes WHERE state = 'final')"
RUNNING = "(SELECT id FROM episodes WHERE state = 'running')"
LEASED = "(SELECT id FROM shards WHERE state = 'leased')"


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        (
            "UPDATE episodes SET success = FALSE WHERE state = 'final'",
            "a final episode is immutable",
        ),
        ("UPDATE episodes SET detail = 'x' WHERE state = 'final'", "a final episode is immutable"),
        ("UPDATE episodes SET thumbnail = NULL", "a final episode is immutable"),
        ("DELETE FROM episodes WHERE state = 'final'", "a final episode is immutable"),
        ("UPDATE decisions SET success = FALSE", "decisions are immutable"),
        ("DELETE FROM decisions", "decisions are immutable"),
        ("UPDATE hidden_changes SET time = 0", "hidden states are immutable"),
        ("DELETE FROM hidden_changes", "hidden states are immutable"),
        ("UPDATE attempts SET reason = 'x' WHERE state = 'done'", "an ended attempt is immutable"),
        ("UPDATE attempts SET fence = 9 WHERE state = 'done'", "an ended attempt is immutable"),
        ("DELETE FROM attempts WHERE state = 'done'", "an ended attempt is immutable"),
        ("UPDATE policy_versions SET spec = '{}'", "a policy version is immutable"),
        ("DELETE FROM policy_versions", "a policy version is immutable"),
        ("UPDATE events SET kind = 'x'", "events are immutable"),
        ("DELETE FROM events", "events are immutable"),
        ("UPDATE divergences SET kept = 'x'", "alarms are immutable"),
        ("DELETE FROM divergences", "alarms are immutable"),
        ("UPDATE blobs SET size = 0", "blobs are immutable"),
        ("DELETE FROM blobs", "blobs are immutable"),
        ("DELETE FROM batches", "batches stay"),
        ("UPDATE episode_labels SET note = 'x'", "labels are immutable"),
        ("DELETE FROM episode_labels", "labels are immutable"),
        ("UPDATE leaderboard_snapshots SET content = '{}'", "snapshots are immutable"),
        ("UPDATE leaderboard_snapshots SET note = 'x'", "snapshots are immutable"),
        ("UPDATE leaderboard_snapshots SET suite = 'x'", "snapshots are immutable"),
        ("DELETE FROM leaderboard_snapshots", "snapshots are immutable"),
    ],
)
def test_what_never_changes(connection: Connection, statement: str, message: str) -> None:
    with pytest.raises(IntegrityError, match=message):
        connection.execute(text(statement))


@pytest.mark.parametrize("table", ["decisions", "hidden_changes"])
def test_nothing_is_added_to_a_final_episode(connection: Connection, table: str) -> None:
    columns = connection.execute(text(f"SELECT * FROM {table}")).keys()
    values = ", ".join("number + 100" if name == "number" else name for name in columns)

    with pytest.raises(IntegrityError, match="a final episode is immutable"):
        connection.execute(text(f"INSERT INTO {table} SELECT {values} FROM {table}"))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("episodes", "a final episode is immutable"),
        ("attempts", "an ended attempt is immutable|begin as open"),
        ("decisions", "a final episode is immutable"),
        ("policy_versions", "a policy version is immutable"),
        ("events", "events are immutable"),
        ("divergences", "alarms are immutable"),
        ("blobs", "blobs are immutable"),
    ],
)
def test_a_row_is_not_replaced_by_another_with_its_key(
    connection: Connection, table: str, message: str
) -> None:
    """INSERT OR REPLACE deletes what is in its way, and by default tells no trigger."""
    if connection.dialect.name != "sqlite":
        pytest.skip("PostgreSQL has no such statement")
    columns = connection.execute(text(f"SELECT * FROM {table}")).keys()
    first = {"episodes": "'pending'", "attempts": "'open'"}
    plain = {"digest", "success", "exact", "committed"} if table == "episodes" else set()
    values = ", ".join(
        first[table] if name == "state" else "NULL" if name in plain else f'"{name}"'
        for name in columns
    )
    where = {"episodes": "WHERE state = 'final'", "attempts": "WHERE state = 'done'"}
    replace = f"INSERT OR REPLACE INTO {table} SELECT {values} FROM {table} {where.get(table, '')}"

    with pytest.raises(IntegrityError, match=message):
        connection.execute(text(replace))


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        (f"UPDATE episodes SET state = 'final' WHERE id = {RUNNING}", "final_is_whole"),
        ("UPDATE episodes SET digest = 'd', success = TRUE, exact = TRUE, committed = '2026-01-01' "
         f"WHERE id = {RUNNING}", "final_is_whole"),
        (f"UPDATE episodes SET exact = TRUE, failure = 'overcount' WHERE id = {RUNNING}",
         "exact_has_no_failure"),
        (f"UPDATE episodes SET exact = FALSE WHERE id = {RUNNING}", "exact_has_no_failure"),
        ("INSERT INTO attempts (id, shard_id, fence, engine, state, token_hash, leased) "
         f"VALUES ('at_2', {LEASED}, 2, 'local', 'open', '', '2026-01-01')",
         "attempts.shard_id|one_open_attempt"),
        ("INSERT INTO attempts (id, shard_id, fence, engine, state, token_hash, leased) "
         "SELECT 'at_2', shard_id, 1, 'local', 'open', '', '2026-01-01' "
         "FROM attempts WHERE state = 'done'",
         "attempts.shard_id, attempts.fence|shard_id_fence_key"),
        (f"UPDATE episodes SET recording = 'ab' WHERE id = {RUNNING}", "FOREIGN KEY|foreign key"),
        ("DELETE FROM shards", "FOREIGN KEY|foreign key"),
        ("DELETE FROM evaluations", "FOREIGN KEY|foreign key"),
        ("DELETE FROM policies", "FOREIGN KEY|foreign key"),
        ("INSERT INTO policies (id, name, created) SELECT 'po_2', name, created FROM policies",
         "policies.name|policies_name_key"),
    ],
)  # fmt: skip
def test_what_the_tables_refuse(connection: Connection, statement: str, message: str) -> None:
    with pytest.raises(IntegrityError, match=message):
        connection.execute(text(statement))


def test_every_time_is_kept_in_utc(connection: Connection) -> None:
    [created] = connection.execute(select(Base.metadata.tables["policies"].c.created).limit(1))

    assert created[0].utcoffset().total_seconds() == 0
