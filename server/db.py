"""The ledger's database: opened, brought up to date, read from and written to.

SQLite in WAL mode, unless it is PostgreSQL (server/postgres.py). A transaction that writes begins
IMMEDIATE: one that reads first and then writes is refused by SQLite when another wrote in between,
whatever the busy time-out is.
"""

import importlib.util
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path
from time import monotonic
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from server import postgres

BUSY_TIMEOUT = 30.0  # s to wait for another writer
CHECKED_FOR = 5.0  # s of looking for damage when it is opened: 1 GB of a file that is in memory
PRAGMAS = (
    "journal_mode = WAL",
    "synchronous = FULL",
    "foreign_keys = ON",
    "recursive_triggers = ON",  # else INSERT OR REPLACE deletes without telling a trigger
)


class LedgerError(Exception):
    """The database file cannot be used; the message is one line, and nothing was touched."""


class Database:
    """An open ledger.

    Args:
        place: SQLite's file, or the address of a PostgreSQL database.

    Raises:
        LedgerError: it is corrupt, another program's, of a newer version, or not writable.
    """

    def __init__(self, place: Path | str):
        self.after_commit: Callable[[], None] = lambda: None  # told of every committed write
        self.engine = _opened(place)
        self._reading, self._writing = self.engine, self.engine.execution_options(writes=True)
        if is_postgres(self.engine):
            self._reading = self.engine.execution_options(**postgres.READING)
        self._claim: postgres.Claim | None = None
        try:
            migrate(self.engine)
        except DBAPIError as error:
            self.engine.dispose()
            where = self.engine.url.database if isinstance(place, Path) else "The database"
            raise LedgerError(_unusable(str(where), str(error.orig))) from None
        except BaseException:
            self.engine.dispose()
            raise

    @property
    def path(self) -> Path:
        """SQLite's file."""
        return Path(self.engine.url.database or "")

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session on one consistent state of the ledger."""
        with Session(self._reading) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A session that holds the only right to write; it commits unless its block raises."""
        with Session(self._writing, expire_on_commit=False) as session, session.begin():
            yield session
        self.after_commit()

    def claim(self) -> None:
        """Keeps other servers from this ledger; of a file, its folder's lock does.

        Raises:
            LedgerError: another server has it.
        """
        if not is_postgres(self.engine):
            return
        try:
            if self._claim is None:
                self._claim = postgres.Claim(self.engine)
            self._claim.keep()
        except postgres.Unusable as error:
            raise LedgerError(str(error)) from None

    def close(self) -> None:
        """Let go of the database."""
        if self._claim:
            self._claim.drop()
        self.engine.dispose()


def _unusable(where: str, fault: str) -> str:
    if "locked" in fault or "readonly" in fault or "disk" in fault:
        return f"{where} cannot be written: {fault}."
    return f"{where} cannot be brought up to date, and was left as it was: {fault}."


def is_postgres(engine: Engine | Connection) -> bool:
    """True unless it is SQLite."""
    return engine.dialect.name == "postgresql"


def _opened(place: Path | str) -> Engine:
    if isinstance(place, Path):
        examine(place)
        return _engine(place)
    try:
        engine = postgres.engine_of(postgres.parsed(place))
        try:
            postgres.examine(engine, known_revisions())
        except BaseException:
            engine.dispose()
            raise
    except postgres.Unusable as error:
        raise LedgerError(str(error)) from None
    return engine


def _engine(path: Path) -> Engine:
    engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": BUSY_TIMEOUT})

    @event.listens_for(engine, "connect")
    def _prepare(connection: Any, _: object) -> None:
        connection.isolation_level = None  # transactions are begun below, not by the driver
        for pragma in PRAGMAS:
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def examine(path: Path) -> None:
    """Looks whether the file is a ledger that this version can use, or is not there yet.

    Raises:
        LedgerError: it is not.
    """
    if not path.exists():
        return
    try:
        with closing(sqlite3.connect(untouched(path), uri=True)) as opened:
            verdict = _checked(opened)
            names = {name for (name,) in opened.execute("SELECT name FROM sqlite_master")}
            revision = revision_of(opened) if "alembic_version" in names else None
    except sqlite3.DatabaseError as error:
        raise LedgerError(
            f"{path} cannot be read as a ledger: {error}. Restore it from a copy, or start with "
            "another data folder."
        ) from None
    if verdict != "ok":
        line = " ".join(str(verdict).split())
        raise LedgerError(f"{path} is damaged: {line}. Restore it from a copy.")
    if names and revision is None:
        raise LedgerError(f"{path} is the database of another program; give another data folder.")
    if revision and revision not in known_revisions():
        raise LedgerError(
            f"{path} was written by a newer version (revision {revision}; this version knows up "
            f"to {known_revisions()[0]}). Update hide-seek."
        )


def _checked(opened: sqlite3.Connection) -> str:
    """What a check of the file finds, or "ok" if it found nothing until the time was over."""
    end = monotonic() + CHECKED_FOR
    opened.set_progress_handler(lambda: monotonic() > end, 100_000)
    try:
        return str(opened.execute("PRAGMA quick_check(1)").fetchone()[0])
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_INTERRUPT:
            raise
        return "ok"
    finally:
        opened.set_progress_handler(None, 0)


def untouched(path: Path) -> str:
    """The address under which SQLite reads a file and makes none beside it."""
    has_log = path.with_name(f"{path.name}-wal").exists()
    return f"{path.absolute().as_uri()}?mode=ro{'' if has_log else '&immutable=1'}"


def revision_of(connection: sqlite3.Connection) -> str | None:
    """The revision of a ledger."""
    row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    return row and str(row[0])


@cache  # every start asks three times, and each reads all migrations
def known_revisions() -> tuple[str, ...]:
    """The revisions of the ledger that this version knows, newest first."""
    found = ScriptDirectory.from_config(migrations()).walk_revisions()
    return tuple(one.revision for one in found)


def migrations(connection: Connection | None = None) -> Config:
    """Alembic's configuration; its commands then run on this connection."""
    spec = importlib.util.find_spec("migrations")
    assert spec is not None and spec.submodule_search_locations is not None
    config = Config()
    folder = spec.submodule_search_locations[0]
    config.set_main_option("script_location", folder.replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    return config


def migrate(engine: Engine, revision: str = "head") -> None:
    """Brings the tables up to a revision, whole or not at all.

    Raises:
        LedgerError: there is no such revision.
    """
    with engine.execution_options(writes=True).begin() as connection:
        try:
            command.upgrade(migrations(connection), revision)
        except CommandError as error:
            raise LedgerError(str(error)) from None
    if is_postgres(engine):
        return
    with closing(engine.raw_connection()) as connection:  # a checkpoint wants no transaction
        connection.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)")
