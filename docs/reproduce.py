"""Repeats the study: demonstrations, trainings, evaluations, tables; interrupted, it goes on.

Run it with: make reproduce, or .venv/bin/python -m docs.reproduce [--tiny] [--plan]

Everything lies in one folder: `demos`, `runs/RUN`, the `data` of a server of its own, `exports`,
and `tables` with the results page. What is there is not done again. Days of work are split with
`--only`: a run that another machine trained counts once its `checkpoint.safetensors` (and its
`losses.jsonl`, for the curves) lies in `runs/RUN`, and what was published there stays in the tables
that are published here.
"""

import argparse
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from docs import make_results
from docs.own_processes import Failed
from docs.results_words import duration
from docs.study_chain import Reproduction, Step
from docs.study_player import say
from seek_model.study import FULL, TINY
from server.client import ServerProblem


def plan(steps: Sequence[Step], known: dict[str, float], out: Path) -> list[str]:
    """What will be done, and how long that took where it was measured."""
    lines = [f"In {out}, with {os.cpu_count()} processors:"] if steps else [f"{out}: all is there."]
    total, unknown = 0.0, False
    for kind, count in Counter(step.kind for step in steps).items():
        names = ", ".join(step.name for step in steps if step.kind == kind)
        seconds = known.get(kind)
        unknown |= seconds is None
        total += count * (seconds or 0.0)
        took = "not measured yet" if seconds is None else f"{duration(count * seconds)} expected"
        lines.append(f"  {count:2} × {kind} ({names}): {took}")
    if steps:
        lines.append(f"  together {duration(total)} expected" + " and what is unknown" * unknown)
    return lines


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m docs.reproduce", description=(__doc__ or "").split("\n\n")[0]
    )
    add = parser.add_argument
    add("--tiny", action="store_true", help="the same chain in minutes: three tasks, few steps")
    add("--plan", action="store_true", help="say what would be done, and stop")
    add("--out", type=Path, help="its folder; default: build/study, or build/study-tiny")
    add("--only", metavar="RUN,…", help="these runs or references alone")
    add("--first", type=Path, metavar="FILE", help="weights in place of the run `first`")
    add("--demos", type=Path, metavar="DIR", help="demonstrations that are elsewhere")
    add("--workers", type=int, metavar="N", help="of the server; default: one per processor")
    add(
        "--at-once",
        type=int,
        default=2,
        metavar="N",
        help="second phases at a time, 7 GB each; default: 2",
    )
    add("--train-only", action="store_true", help="stop before the evaluations")
    add("--recordings", action="store_true", help="keep a recording of every episode")
    add("--publish", action="store_true", help="write docs/study, docs/results.md and README.md")
    found = parser.parse_args()
    if found.at_once < 1:
        parser.error(f"--at-once {found.at_once}: give 1 or more")
    found.out = (found.out or Path("build", "study-tiny" if found.tiny else "study")).absolute()
    for name in ("demos", "first"):
        if path := getattr(found, name):
            setattr(found, name, path.absolute())
    return found


def run(arguments: argparse.Namespace) -> None:
    """Plans, says so, does it, and writes the tables.

    Raises:
        Failed: a step did.
    """
    study = TINY if arguments.tiny else FULL
    chain = Reproduction(study, arguments)
    if not arguments.plan:
        chain.hold()
    steps = chain.steps()
    for line in plan(steps, make_results.expected_seconds(study), chain.out):
        print(line, flush=True)
    if arguments.plan:
        return
    expected = make_results.committed(study)
    chain.do(steps)
    tables = chain.out / "tables"
    found = make_results.write(study, chain.out, tables, first=arguments.first)
    if arguments.publish:
        make_results.publish(study, chain.out, first=arguments.first)
    for line in make_results.beside(found, expected):
        print(line)
    say(f"Tables: {tables / make_results.PAGE}")


def main() -> int:
    """The exit status."""
    try:
        run(options())
    except (Failed, ServerProblem, ValueError) as error:
        print(f"reproduce: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("Stopped; the same line goes on.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
