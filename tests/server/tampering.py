"""What somebody with the files of a stopped server may do to them."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from server.settings import LEDGER
from server.verification.episodes import CHANGE, DECISION, RESULT
from workers.protocol import digest_of_documents


def alter(folder: Path, *statements: str) -> None:
    """Runs SQL over a ledger whose triggers are gone."""
    with closing(sqlite3.connect(folder / LEDGER)) as opened, opened:
        triggers = "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        for (name,) in opened.execute(triggers).fetchall():
            opened.execute(f"DROP TRIGGER {name}")
        for statement in statements:
            assert opened.execute(statement).rowcount > 0, statement


def ask(folder: Path, query: str) -> list[tuple[Any, ...]]:
    """The rows that a ledger answers."""
    with closing(sqlite3.connect(folder / LEDGER)) as opened:
        return opened.execute(query).fetchall()


def seal(folder: Path, episode: str) -> None:
    """Gives an episode the digest that its rows have now, as somebody who knows the code would."""
    with closing(sqlite3.connect(folder / LEDGER)) as opened, opened:
        opened.row_factory = sqlite3.Row
        of = opened.execute
        row = dict(of("SELECT * FROM episodes WHERE id = ?", [episode]).fetchone())
        result = {name: row[name] for name in RESULT}
        result |= {"variation": json.loads(row["variation"])}
        result |= {name: bool(row[name]) for name in ("success", "exact")}
        decisions = [
            {"decision": number, **_document(one, DECISION)}
            for number, one in enumerate(_rows(of, "decisions", episode))
        ]
        changes = [_document(one, CHANGE) for one in _rows(of, "hidden_changes", episode)]
        digest = digest_of_documents(result, json.loads(row["start"]), decisions, changes)
        of("UPDATE episodes SET digest = ? WHERE id = ?", [digest, episode])


def _rows(of: Callable[..., Any], table: str, episode: str) -> list[sqlite3.Row]:
    order = f"SELECT * FROM {table} WHERE episode_id = ? ORDER BY number"
    return list(of(order, [episode]))


def _document(row: sqlite3.Row, names: tuple[str, ...]) -> dict[str, Any]:
    read = {name: row[name] for name in names}
    for name in ("action", "hidden", "checks", "events", "violations", "belief"):
        if read.get(name) is not None:
            read[name] = json.loads(read[name])
    return read | {name: bool(read[name]) for name in ("success", "retried") if name in read}


def edit_blob(folder: Path, sha256: str) -> None:
    """Changes one byte of a file that is kept under its hash."""
    path = folder / "blobs" / sha256[:2] / sha256[2:]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def everything(folder: Path) -> dict[str, bytes]:
    """All files below a folder and what they hold."""
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}
