"""What the members of a cluster know each other by; made once, kept in the data folder.

Dask's ports run whatever they are sent, so no member talks to whoever cannot show the certificate.
"""

import json
import os
from pathlib import Path

from server.arguments import BadUsage
from workers.engines.membership import Membership

FILE = "cluster.json"


def membership(folder: Path, scheduler: str) -> Membership:
    """What a machine is told that may join.

    Args:
        folder: where certificate and key are kept.
        scheduler: under which address members reach the scheduler.

    Raises:
        BadUsage: what it takes is not installed.
    """
    path = folder / FILE
    if not path.exists():
        _write(path, _made())
    return Membership(scheduler=scheduler, **json.loads(path.read_text()))


def _made() -> dict[str, str]:
    try:
        from distributed import Security

        made = Security.temporary()
    except ImportError:
        raise BadUsage("A cluster wants Dask: pip install 'hide-seek[dask]'.") from None
    return {"certificate": made.tls_client_cert, "key": made.tls_client_key}


def _write(path: Path, content: dict[str, str]) -> None:
    """Nobody else may read it, nor half of it be found."""
    part = path.with_suffix(".part")
    part.unlink(missing_ok=True)
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        json.dump(content, file)
    part.replace(path)
