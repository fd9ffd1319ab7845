"""Registers a policy that somebody serves, and shows where it goes wrong while it is played.

    hide serve-policy checkpoint.safetensors --port 8001          # or any openpi server
    hide serve --allow-remote 127.0.0.1
    python examples/watch_a_remote_policy.py ws://127.0.0.1:8001 mine search_drawer

For each failed episode it prints a line: what it was to do, how it ended, and what was true then,
hidden from the policy. HIDE_URL says where the server is, HIDE_TOKEN lets in.
"""

import os
import sys

from server.client import LOCAL, Client
from workers.protocol import RemotePolicy


def describe(client: Client, episode: str) -> str:
    """A failed episode in a line: what it was to do, how it ended, what was true then."""
    found = client.episode(episode)
    decisions = client.decisions(episode)
    hidden = decisions[-1].hidden if decisions else {}
    where = f"{found.task} {found.index} ({found.instruction})"
    return f"{where}: {found.failure} after {found.decisions} decisions, in {found.stage}: {hidden}"


def main(url: str, name: str, tasks: list[str]) -> int:
    with Client(os.environ.get("HIDE_URL", LOCAL), os.environ.get("HIDE_TOKEN")) as client:
        version = client.register(name, RemotePolicy(url=url), "watched by an example")
        wanted = {"tasks": tasks, "episodes": 1} if tasks else {}
        evaluation = client.evaluate(version.id, **wanted)
        for one in client.events(evaluation.id):
            if one.kind == "progress":
                progress = one.data["progress"]
                print(f"{progress['final']} of {progress['expected']}", file=sys.stderr)
            elif one.kind == "episode" and one.data["state"] == "final" and one.data["failure"]:
                print(describe(client, one.data["id"]))
        done = client.evaluation(evaluation.id)
    print(
        f"{done.verdicts.exact.successes} of {done.verdicts.exact.episodes} exact", file=sys.stderr
    )
    return 0 if done.state == "completed" else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], sys.argv[3:]))
