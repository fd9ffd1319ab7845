"""Measures how soon an evaluation goes on after a kill, and whether it is what it would have been.

Run it with: .venv/bin/python docs/measure_recovery.py [FILE [ROUNDS]]
A part is killed while a policy decides; what is measured is the time until the next episode is
final. A round takes about three minutes; the machine should have nothing else to do.
"""

import json
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from hide_tasks.machine import fingerprint
from tests.chaos.systems import PATIENCE, SYSTEMS, System
from tests.server.running import until

EPISODES = 4


def after(system: System, victim: str, quiet: dict[int, Any]) -> dict[str, float]:
    """Seconds from a kill until the next episode is final, and what was lost or altered."""
    decides = system.deciding()
    evaluation = system.ask(episodes=EPISODES)
    until(decides, "a decision", PATIENCE)
    before, final = system.committed(), system.server.final(evaluation)
    began = time.perf_counter()
    system.kill(victim)  # with the start of another one, if somebody has to start it
    until(lambda: system.server.final(evaluation) > final, "an episode", PATIENCE)
    seconds = time.perf_counter() - began
    system.finished(evaluation)
    found, now = system.scores(evaluation), system.committed()
    altered = sum(now.get(id) != was for id, was in before.items())
    return {
        "seconds": seconds,
        "lost": EPISODES - len(found),
        "altered": altered + sum(found[index] != quiet[index] for index in found),
    }


def measured(system: System) -> dict[str, dict[str, float]]:
    """The same of every part, by name."""
    evaluation = system.ask(episodes=EPISODES)
    system.finished(evaluation)
    quiet = system.scores(evaluation)
    return {victim: after(system, victim, quiet) for victim in system.victims}


def told(rows: list[dict[str, Any]]) -> str:
    """One line of a part's rounds."""
    took = median(row["seconds"] for row in rows)
    spoiled = sum(row["lost"] + row["altered"] for row in rows)
    first = rows[0]
    return (
        f"{first['engine']}, killed {first['killed']}: next episode final after {took:.1f} s, "
        f"{spoiled:.0f} episodes lost or altered"
    )


def main() -> None:
    """Prints the median of each part's rounds, and writes all of them."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    kills: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for engine, kind in SYSTEMS.items():
        for _ in range(rounds):
            with TemporaryDirectory() as folder, kind(Path(folder)) as system:
                for victim, found in measured(system).items():
                    row = {"engine": engine, "killed": victim, **found}
                    kills.setdefault((engine, victim), []).append(row)
    for rows in kills.values():
        print(told(rows))
    if file:
        figures = {
            "machine": fingerprint(),
            "kills": [one for rows in kills.values() for one in rows],
        }
        file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
