"""Runs migrations on the connection that the caller holds, in the caller's transaction."""

from alembic import context

from migrations import postgres_triggers
from server.db import is_postgres
from server.models import Base

connection = context.config.attributes["connection"]
context.configure(
    connection=connection,
    target_metadata=Base.metadata,
    render_as_batch=True,  # SQLite alters a table by copying it
)
if is_postgres(connection):
    postgres_triggers.translate(connection)
context.run_migrations()
if is_postgres(connection):
    postgres_triggers.tidy(connection)
