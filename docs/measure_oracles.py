"""What limits a checkpoint: it plays as it is, then with true counts, a true anchor, both.

Run it with: .venv/bin/python -m docs.measure_oracles NAME=CHECKPOINT … [--split val]
    [--episodes 25]
    [--tasks a,b] [--kinds own,true_counts] [--out docs/study/oracles.json]

Episodes are played outside of the ledger: a policy that is told hidden values has no place on a
leaderboard. Prints successes, and writes by policy, kind and task [successes, episodes]; what the
file has already of a checkpoint, by its SHA-256, is not played again.
"""

import argparse
import hashlib
import json
import multiprocessing
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

from hide_tasks import SUITES, suite
from hide_tasks.contract import EpisodeSpec, Split

OUT = Path(__file__).with_name("study") / "oracles.json"


class Run(NamedTuple):
    """An episode to play."""

    path: str  # of the checkpoint
    kind: str  # what it is told
    spec: EpisodeSpec


def played(run: Run) -> tuple[bool, str]:
    """Whether it succeeded, and the failure's name."""
    from hide_tasks.episode import play

    result, _ = play(run.spec, policy(run.path, run.kind))
    return result.success, result.failure or ""


@cache
def policy(path: str, kind: str) -> Any:
    """The policy of this process that is told what `kind` says."""
    import torch

    from seek_model.told import load

    torch.set_num_threads(1)
    return load(Path(path), kind)  # type: ignore[arg-type]


def measured(
    path: Path, kind: str, specs: Sequence[EpisodeSpec], pool: ProcessPoolExecutor
) -> dict[str, Any]:
    """Successes and episodes, overall and by task, and how often what went wrong."""
    found: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    wrong: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    runs = [Run(str(path), kind, spec) for spec in specs]
    for run, (success, failure) in zip(runs, pool.map(played, runs), strict=True):
        found[run.spec.task][0] += success
        found[run.spec.task][1] += 1
        if failure:
            wrong[run.spec.task][failure] += 1
    overall = [sum(one[i] for one in found.values()) for i in (0, 1)]
    return {"overall": overall, "tasks": dict(found), "failures": wrong}


def asked(arguments: argparse.Namespace) -> Iterator[tuple[str, Path, str]]:
    """Every policy and kind."""
    for text in arguments.policies:
        name, _, path = text.partition("=")
        if not path or not Path(path).is_file():
            sys.exit(f"{text}: expected NAME=CHECKPOINT, and a file that is there")
        for kind in arguments.kinds.split(","):
            yield name, Path(path), kind


def read() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policies", nargs="+", metavar="NAME=CHECKPOINT")
    parser.add_argument("--split", choices=get_args(Split), default="val")
    parser.add_argument("--episodes", type=int, default=25)
    parser.add_argument("--tasks", default=",".join(SUITES[suite.SUITE]))
    parser.add_argument("--kinds", default="own,true_counts,true_anchors,both")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    return parser.parse_args()


def main() -> None:
    """Plays, prints and writes."""
    arguments = read()
    tasks = arguments.tasks.split(",")
    specs = [s for task in tasks for s in suite.episodes(task, arguments.split, arguments.episodes)]
    there = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, context) as pool:
        for name, path, kind in asked(arguments):
            of = there.setdefault(name, {})
            origin = {
                "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                "split": arguments.split,
                "episodes": arguments.episodes,
            }
            if of.get(kind, {}).get("of") != origin or of[kind]["tasks"].keys() != set(tasks):
                of[kind] = {"of": origin, **measured(path, kind, specs, pool)}
                arguments.out.parent.mkdir(parents=True, exist_ok=True)
                arguments.out.write_text(json.dumps(there, indent=1) + "\n")
            report(name, kind, of[kind])


def report(name: str, kind: str, found: dict[str, Any]) -> None:
    """Prints it."""
    good, all_ = found["overall"]
    print(f"{name}, told {kind}: {good} of {all_} ({100 * good / max(all_, 1):.1f} %)", flush=True)
    for task, (success, episodes) in found["tasks"].items():
        print(f"    {task:26} {success:3} of {episodes}   {dict(found['failures'].get(task, {}))}")


if __name__ == "__main__":
    main()
