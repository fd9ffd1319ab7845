"""SQLite's triggers, said to PostgreSQL: a migration writes one statement for both.

The statement has the form `CREATE TRIGGER name BEFORE … ON table FOR EACH ROW [WHEN …] BEGIN SELECT
RAISE(ABORT, 'message'); END`. PostgreSQL wants a function for it, and knows TRUNCATE besides, which
tells no trigger of a row.
"""

import re
from typing import Any

from sqlalchemy import Connection, event, text

FORM = re.compile(
    r"CREATE TRIGGER (?P<name>\w+) BEFORE (?P<what>INSERT|UPDATE|DELETE)(?P<of> OF \w+)? "
    r"ON (?P<table>\w+) FOR EACH ROW(?: WHEN (?P<when>.+?))? "
    r"BEGIN SELECT RAISE\(ABORT, (?P<message>'[^']*')\); END",
    re.DOTALL,
)
FUNCTION = """
CREATE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  IF {when} THEN
    RAISE EXCEPTION USING MESSAGE = {message}, ERRCODE = 'integrity_constraint_violation';
  END IF;
  IF TG_OP = 'DELETE' THEN RETURN OLD; END IF;
  RETURN NEW;
END $$"""
WITHOUT_TRIGGER = """
SELECT proname FROM pg_proc AS p
WHERE prorettype = 'trigger'::regtype AND pronamespace = current_schema()::regnamespace
  AND NOT EXISTS (SELECT FROM pg_trigger AS t WHERE t.tgfoid = p.oid)"""


def translate(connection: Connection) -> None:
    """From now on this connection understands triggers as they are written for SQLite."""
    event.listen(connection, "before_cursor_execute", _translated, retval=True)


def _translated(
    _: Connection, cursor: Any, statement: str, parameters: Any, *_rest: Any
) -> tuple[str, Any]:
    found = FORM.fullmatch(statement)
    if found is None:
        return statement, parameters
    part = found.groupdict() | {"when": found["when"] or "TRUE", "of": found["of"] or ""}
    cursor.execute(FUNCTION.format(**part))
    if part["what"] == "DELETE":
        emptied = part | {"name": f"{part['name']}_all", "when": "TRUE"}
        cursor.execute(FUNCTION.format(**emptied))
        cursor.execute(
            "CREATE TRIGGER {name} BEFORE TRUNCATE ON {table} EXECUTE FUNCTION {name}()".format(
                **emptied
            )
        )
    trigger = "CREATE TRIGGER {name} BEFORE {what}{of} ON {table} FOR EACH ROW "
    return f"{trigger}EXECUTE FUNCTION {{name}}()".format(**part), parameters


def tidy(connection: Connection) -> None:
    """Drops the functions whose triggers went with their tables."""
    for name in connection.scalars(text(WITHOUT_TRIGGER)).all():
        connection.execute(text(f"DROP FUNCTION {name}()"))
