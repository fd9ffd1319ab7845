"""The database allows the moves of server/states.py, and no others, whoever asks for them."""

from collections.abc import Iterator
from enum import StrEnum
from itertools import permutations

import pytest
from sqlalchemy import Connection, text
from sqlalchemy.exc import IntegrityError

from server.states import MOVES, AttemptState, EpisodeState, EvaluationState, ShardState
from tests.server import ledgers

pytestmark = pytest.mark.usefixtures("on_each_database")

TABLES: dict[type[StrEnum], str] = {
    EvaluationState: "evaluations",
    ShardState: "shards",
    AttemptState: "attempts",
    EpisodeState: "episodes",
}
VERDICT = ", digest = 'd', success = TRUE, exact = TRUE, committed = '2026-01-01 00:00:00'"
PAIRS = [(kind, old, new) for kind in MOVES for old, new in permutations(MOVES[kind], 2)]
STATES = [(kind, state) for kind in MOVES for state in MOVES[kind]]


@pytest.fixture(scope="module")
def ledger(on_each_database: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Connection]:
    """A ledger in which every table with states has one row, in its first state."""
    database = ledgers.opened(tmp_path_factory.mktemp("states"), on_each_database)
    with database.writing() as session:
        ledgers.created(session, tasks=["search_drawer"], episodes=1)
    with database.engine.execution_options(writes=True).connect() as connection:
        connection.execute(
            text(
                "INSERT INTO attempts (id, shard_id, fence, engine, state, token_hash, leased) "
                "SELECT 'at_1', id, 1, 'local', 'open', '', '2026-01-01' "
                "FROM shards"
            )
        )
        connection.commit()
        yield connection
    database.close()


@pytest.fixture
def connection(ledger: Connection) -> Iterator[Connection]:
    yield ledger
    ledger.rollback()


def path_to(kind: type[StrEnum], state: str) -> list[str]:
    """The states on the shortest way to a state, without the first."""
    ways: list[list[str]] = [[next(iter(MOVES[kind]))]]
    for way in ways:
        if way[-1] == state:
            return way[1:]
        ways += [[*way, after] for after in MOVES[kind][way[-1]] if after not in way]
    raise AssertionError(f"{state} cannot be reached")


def move(connection: Connection, kind: type[StrEnum], state: str) -> None:
    verdict = VERDICT if (kind, state) == (EpisodeState, "final") else ""
    connection.execute(text(f"UPDATE {TABLES[kind]} SET state = :state{verdict}"), {"state": state})


def test_moves_name_every_state() -> None:
    for kind, moves in MOVES.items():
        assert set(moves) == {state.value for state in kind}
        assert {after for possible in moves.values() for after in possible} <= set(moves)


@pytest.mark.parametrize(("kind", "old", "new"), PAIRS)
def test_the_database_allows_exactly_the_moves(
    connection: Connection, kind: type[StrEnum], old: str, new: str
) -> None:
    for state in path_to(kind, old):
        move(connection, kind, state)

    if new in MOVES[kind][old]:
        move(connection, kind, new)
    else:
        with pytest.raises(IntegrityError, match=r"do not move so|is immutable"):
            move(connection, kind, new)


@pytest.mark.parametrize(("kind", "state"), STATES)
def test_no_state_moves_to_one_that_does_not_exist(
    connection: Connection, kind: type[StrEnum], state: str
) -> None:
    for step in path_to(kind, state):
        move(connection, kind, step)

    with pytest.raises(IntegrityError, match=r"do not move so|is immutable"):
        move(connection, kind, "asleep")


@pytest.mark.parametrize(("kind", "state"), [*STATES, *((kind, "asleep") for kind in MOVES)])
def test_a_row_begins_in_the_first_state(
    connection: Connection, kind: type[StrEnum], state: str
) -> None:
    table = TABLES[kind]
    columns = connection.execute(text(f"SELECT * FROM {table}")).keys()
    values = ", ".join(":state" if name == "state" else f'"{name}"' for name in columns)
    copy = text(f"INSERT INTO {table} SELECT {values} FROM {table}")

    first = state == next(iter(MOVES[kind]))
    message = "UNIQUE|unique" if first else f"{table} begin as"
    with pytest.raises(IntegrityError, match=message):
        connection.execute(copy, {"state": state})
