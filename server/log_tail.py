"""The end of what workers print: tracebacks of theirs, and what a policy's libraries say."""

from pathlib import Path

from server.hub import WORKERS_LOG, Hub
from server.schemas.history import WorkersLog

MOST = 16_000  # bytes


def of(hub: Hub) -> WorkersLog:
    """The last lines; none of a server whose workers are on other machines."""
    return WorkersLog(lines=_lines(hub.folder.logs / WORKERS_LOG))


def _lines(path: Path) -> list[str]:
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - MOST))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return []
    lines = text.splitlines()
    return lines[1:] if size > MOST else lines
