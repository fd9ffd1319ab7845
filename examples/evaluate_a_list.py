"""Has a server evaluate every policy of a list, and writes their rates as CSV.

    python examples/evaluate_a_list.py policies.csv > rates.csv

`policies.csv` has a line `policy,tasks,episodes` and one line for each evaluation; tasks have
spaces between, and what is empty means all. HIDE_URL says where the server is, HIDE_TOKEN lets in.
"""

import csv
import os
import sys
from pathlib import Path
from typing import Any

from server.client import LOCAL, Client


def read(row: dict[str, str]) -> dict[str, Any]:
    """An evaluation as the API takes it."""
    wanted: dict[str, Any] = {"policy": row["policy"]}
    if row["tasks"]:
        wanted["tasks"] = row["tasks"].split()
    if row["episodes"]:
        wanted["episodes"] = int(row["episodes"])
    return wanted


def main(file: Path) -> int:
    with file.open(newline="") as lines:
        wanted = [read(row) for row in csv.DictReader(lines)]
    writer = csv.writer(sys.stdout)
    writer.writerow(["policy", "evaluation", "state", "episodes", "success", "low", "high"])
    bad = 0
    with Client(os.environ.get("HIDE_URL", LOCAL), os.environ.get("HIDE_TOKEN")) as client:
        batch = client.evaluate_many(wanted)
        for one, item in zip(wanted, batch.items, strict=True):
            if item.evaluation is None:
                bad += 1
                print(f"{one['policy']}: {(item.problem or {}).get('detail')}", file=sys.stderr)
                continue
            done = client.wait(item.evaluation.id)
            bad += done.state != "completed"
            rate = done.verdicts.success
            numbers = [f"{number:.4f}" for number in (rate.value or 0.0, rate.low, rate.high)]
            writer.writerow([done.policy, done.id, done.state, rate.episodes, *numbers])
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
