"""Writes docs/openapi.json, the API as programs know it; refuses what would break them.

.venv/bin/python -m docs.make_openapi            # --break: they shall break, and v1 is over
"""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from docs.openapi_changes import breaking

FILE = Path(__file__).with_name("openapi.json")


def present() -> dict[str, Any]:
    """The document as the application describes itself now, without its version."""
    from server.app import create_app
    from server.settings import Settings

    with TemporaryDirectory() as folder:
        app = create_app(Settings(data=Path(folder), workers=0, references=False))
        document: dict[str, Any] = json.loads(json.dumps(app.openapi()))
        app.state.hub.stop()
    document["info"]["version"] = "1"  # of the API
    return document


def written(document: dict[str, Any]) -> str:
    """The document as the file holds it."""
    return json.dumps(document, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def main(arguments: list[str]) -> int:
    new = present()
    found = breaking(json.loads(FILE.read_text()), new) if FILE.exists() else []
    for line in found:
        print(line, file=sys.stderr)
    if found and arguments != ["--break"]:
        print("Nothing was written: additive changes only within v1.", file=sys.stderr)
        return 2
    FILE.write_text(written(new))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
