"""Writes the next migration: what `server/models.py` says and the last migration does not."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from alembic import command

from server.db import Database, known_revisions, migrations


def main() -> None:
    """The only argument says what changes."""
    with TemporaryDirectory() as folder:
        database = Database(Path(folder) / "ledger.sqlite3")
        with database.engine.begin() as connection:
            number = f"{int(known_revisions()[0]) + 1:04d}"
            config = migrations(connection)
            command.revision(config, sys.argv[1], autogenerate=True, rev_id=number)


if __name__ == "__main__":
    main()
