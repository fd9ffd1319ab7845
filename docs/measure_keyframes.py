"""How many keyframes a checkpoint gets right on the demonstrations of split val.

Run it with: .venv/bin/python -m docs.measure_keyframes NAME=CHECKPOINT … --data demos
    [--episodes 25] [--out docs/study/keyframes.json]

The demonstration is followed, whatever the policy says, so every keyframe counts once and no slip
costs those after it: what is left is perception and recall. `seek_model.validation` says what the
numbers mean; those that begin with `own` are with the policy's own counts.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import torch

from seek_model import checkpoint
from seek_model.config import Train
from seek_model.store import Store
from seek_model.validation import Precision, validate, whole_episodes

OUT = Path(__file__).with_name("study") / "keyframes.json"


def measured(path: Path, store: Store, episodes: int) -> dict[str, Any]:
    """The summary of `validate`, overall and by task, and of which file it is."""
    network, _, _ = checkpoint.load(path)
    settings = Train(validate_episodes=episodes)
    found = validate(
        network, whole_episodes(store, settings), Precision(torch.device("cpu"), bf16=False)
    )
    return {"sha256": hashlib.sha256(path.read_bytes()).hexdigest(), **found}


def main() -> None:
    """Prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policies", nargs="+", metavar="NAME=CHECKPOINT")
    parser.add_argument("--data", type=Path, default=Path("demos"))
    parser.add_argument("--episodes", type=int, default=25)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    found = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    for text in arguments.policies:
        name, _, path = text.partition("=")
        if not path or not Path(path).is_file():
            sys.exit(f"{text}: expected NAME=CHECKPOINT, and a file that is there")
        views = checkpoint.read_header(Path(path)).config.model.views
        store = Store.open(arguments.data / f"keyframes-{views.points}-{views.voxel:g}")
        found[name] = measured(Path(path), store, arguments.episodes)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(found, indent=1) + "\n")
        report(name, found[name])


def report(name: str, found: dict[str, Any]) -> None:
    """Prints what limits it, a line a task."""
    columns = ("keyframe", "own_keyframe", "position_cm", "position_near", "coarse_near",
               "rotation_degrees", "opening", "boundary_recall", "boundary_precision",
               "own_count", "stop")  # fmt: skip
    print(f"{name:26} " + " ".join(f"{column[:12]:>12}" for column in columns))
    for task, values in {"all": found["overall"], **found["tasks"]}.items():
        told = [values[column] for column in columns]
        print(
            f"  {task:24} " + " ".join(f"{'–' if v is None else v:>12}" for v in told), flush=True
        )


if __name__ == "__main__":
    main()
