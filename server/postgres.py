"""A ledger in PostgreSQL, for more readers and writers than one file serves.

One writes at a time, as with SQLite's BEGIN IMMEDIATE: a transaction that writes takes an advisory
lock first and reads afterwards, so it sees all that was written before it. Readers wait for
nobody. What PostgreSQL says otherwise than SQLite is made alike here.
"""

import contextlib
from collections.abc import Sequence
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, inspect, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError

DRIVER = "postgresql+psycopg"
WRITER, HOLDER = 0x48494445, 0x5345454B  # keys of advisory locks: of a writer, of a server
LOCK_TIMEOUT = 30_000  # ms to wait for another writer
CONNECTING: dict[str, Any] = {
    "connect_timeout": 10,  # s
    "keepalives_idle": 10,  # s; a server of which nothing is heard lets go of its locks
    "keepalives_interval": 5,  # s
    "keepalives_count": 3,
}
READING: dict[str, Any] = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}


class Unusable(Exception):
    """This database cannot hold the ledger; the message is one line, without a password."""


def parsed(address: str) -> URL:
    """The address of a database.

    Raises:
        Unusable: it is none, or not PostgreSQL's.
    """
    url = None
    with contextlib.suppress(ArgumentError):
        url = make_url(address)
    if url is None or url.drivername not in (DRIVER, "postgresql") or not url.database:
        raise Unusable(f"The database should be like {DRIVER}://user:password@host/name.")
    return url.set(drivername=DRIVER)


def engine_of(url: URL) -> Engine:
    """Connections whose transactions may write if they have the execution option `writes`.

    Raises:
        Unusable: the driver is not installed.
    """
    try:
        engine = create_engine(
            url, connect_args=CONNECTING, pool_size=10, max_overflow=30, pool_pre_ping=True
        )
    except ModuleNotFoundError:
        raise Unusable("PostgreSQL wants psycopg: pip install 'hide-seek[postgres]'.") from None
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def _begin(connection: Connection) -> None:
    if connection.get_execution_options().get("writes", False):
        connection.exec_driver_sql(f"SET LOCAL lock_timeout = {LOCK_TIMEOUT}")
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITER})")


def _prepare(connection: Any, _: object) -> None:
    """Text may hold NUL, and a sum of whole numbers is one, as with SQLite."""
    from psycopg.adapt import Loader
    from psycopg.types.string import StrDumper

    class Text(StrDumper):
        def dump(self, obj: str) -> Any:
            return super().dump(obj.replace("\0", "\N{REPLACEMENT CHARACTER}"))

    class Number(Loader):
        def load(self, data: Any) -> int | float:
            number = bytes(data)
            return int(number) if number.lstrip(b"-").isdigit() else float(number)

    connection.adapters.register_dumper(str, Text)
    connection.adapters.register_loader("numeric", Number)


def examine(engine: Engine, known: Sequence[str]) -> None:
    """Looks whether the database holds a ledger that this version can use, or nothing.

    Args:
        known: the revisions that this version knows, newest first.

    Raises:
        Unusable: it cannot be reached, or does not.
    """
    place = engine.url.render_as_string(hide_password=True)
    try:
        with engine.connect() as connection:
            encoding = connection.scalar(text("SHOW server_encoding"))
            tables = inspect(connection).get_table_names()
            revision = None
            if "alembic_version" in tables:
                revision = connection.scalar(text("SELECT version_num FROM alembic_version"))
    except DBAPIError as error:
        raise Unusable(f"{place} cannot be used: {_line(error)}.") from None
    if encoding != "UTF8":
        raise Unusable(f"{place} keeps text as {encoding}; create the database with UTF8.")
    if tables and "alembic_version" not in tables:
        raise Unusable(f"{place} is the database of another program; give another one.")
    if revision and revision not in known:
        raise Unusable(
            f"{place} was written by a newer version (revision {revision}; this version knows up "
            f"to {known[0]}). Update hide-seek."
        )


def _line(error: DBAPIError) -> str:
    return " ".join(str(error.orig).split()).rstrip(".")


class Claim:
    """That one server hands out the work of a ledger: a lock that ends with its connection.

    Raises:
        Unusable: another server has it.
    """

    def __init__(self, engine: Engine):
        self._engine = engine.execution_options(isolation_level="AUTOCOMMIT")
        self._connection = self._taken()

    def _taken(self) -> Connection:
        connection = self._engine.connect()
        if connection.scalar(text(f"SELECT pg_try_advisory_lock({HOLDER})")):
            return connection
        connection.close()
        place = self._engine.url.render_as_string(hide_password=True)
        raise Unusable(f"{place} is in use by another server; stop it, or give another database.")

    def keep(self) -> None:
        """Takes it anew if the connection broke.

        Raises:
            Unusable: another server was faster.
            DBAPIError: the database cannot be reached.
        """
        with contextlib.suppress(DBAPIError):
            if not self._connection.closed:
                self._connection.exec_driver_sql("SELECT 1")
                return
        self.drop()
        self._connection = self._taken()

    def drop(self) -> None:
        """Lets another server have it; the pool must not keep a connection with the lock."""
        if not self._connection.closed:
            self._connection.invalidate()
            self._connection.close()
