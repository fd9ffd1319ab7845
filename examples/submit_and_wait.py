"""Uploads a checkpoint, has a server evaluate it, and waits for its success rates.

    python examples/submit_and_wait.py checkpoint.safetensors search_drawer reopen_drawer

HIDE_URL says where the server is, HIDE_TOKEN lets in. Interrupted? The same line goes on with the
upload, and asks for another evaluation of the same version.
"""

import os
import sys
from pathlib import Path

from server.client import LOCAL, Client, Happening


def tell(one: Happening) -> None:
    """An episode that was committed, as it comes."""
    if one.kind == "episode" and one.data["state"] == "final":
        verdict = "success" if one.data["success"] else one.data["failure"]
        print(f"{one.data['task']} {one.data['index']}: {verdict}", file=sys.stderr)


def main(file: Path, tasks: list[str]) -> int:
    server = os.environ.get("HIDE_URL", LOCAL)
    with Client(server, os.environ.get("HIDE_TOKEN")) as client:
        version = client.upload(file, file.stem)
        evaluation = client.evaluate(version.id, tasks=tasks or None, episodes=1 if tasks else None)
        print(f"{server}/evaluations/{evaluation.id}", file=sys.stderr)
        done = client.wait(evaluation.id, tell)
    for name, rate in (("success", done.verdicts.success), ("exact", done.verdicts.exact)):
        low, high = 100 * rate.low, 100 * rate.high
        print(f"{name}: {rate.successes} of {rate.episodes} [{low:.0f} %, {high:.0f} %]")
    return 0 if done.state == "completed" else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
