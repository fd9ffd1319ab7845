"""How often the expert's motion succeeds in the dense action spaces, replayed without looking.

Run it with: .venv/bin/python -m docs.measure_dense [--split test] [--episodes 25] [--tasks a,b]
    [--workers 2] [--out docs/study/dense.json]

Plays every episode once as rows of joint_position and once as rows of ee_delta, in chunks of half
a second. Prints a Markdown table, and writes every episode's verdicts. What the file has already
is not played again, so an interrupted measurement goes on; delete the file after a change of the
simulator.
"""

import argparse
import json
import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, get_args

from hide_tasks import ALL_TASKS, suite
from hide_tasks.contract import EpisodeSpec, Split
from hide_tasks.statistics import Rate

OUT = Path(__file__).with_name("study") / "dense.json"
MODES = ("joint_position", "ee_delta")
Verdicts = dict[str, dict[str, Any]]  # by mode


def played(spec: EpisodeSpec) -> Verdicts:
    """What each mode reaches in an episode."""
    from hide_tasks.dense import DenseError, motion
    from hide_tasks.episode import play
    from hide_tasks.policies import Replay

    try:
        found = motion(spec)
    except DenseError as error:
        return {mode: _verdict(False, False, str(error)) for mode in MODES}
    results = {mode: play(spec, Replay(found.chunks(mode)))[0] for mode in MODES}  # type: ignore[arg-type]
    return {
        mode: {**_verdict(one.success, one.exact, one.failure or ""), "rows": len(found)}
        for mode, one in results.items()
    }


def _verdict(success: bool, exact: bool, failure: str) -> dict[str, Any]:
    return {"success": success, "exact": exact, "failure": failure}


def measure(specs: Sequence[EpisodeSpec], out: Path, workers: int) -> dict[str, Verdicts]:
    """The verdicts of the episodes by name; the file is written after each."""
    there: dict[str, Verdicts] = json.loads(out.read_text()) if out.exists() else {}
    out.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        ahead = {pool.submit(played, spec): spec for spec in specs if spec.name not in there}
        for future in as_completed(ahead):
            there[ahead[future].name] = future.result()
            part = out.with_suffix(".part")
            part.write_text(json.dumps(there, indent=1, sort_keys=True) + "\n")
            part.replace(out)
    return {spec.name: there[spec.name] for spec in specs}


def table(found: Mapping[str, Verdicts], specs: Sequence[EpisodeSpec]) -> Iterator[str]:
    """Lines of Markdown: a task a line, then all."""
    heads = [f"{mode} {verdict}" for mode in MODES for verdict in ("success", "exact")]
    yield f"| task | {' | '.join(heads)} |"
    yield f"|---|{'---|' * len(heads)}"
    tasks = {spec.task: [one for one in specs if one.task == spec.task] for spec in specs}
    for name, some in {**tasks, "all": specs}.items():
        yield f"| {name} | {' | '.join(_cells(found, some))} |"


def _cells(found: Mapping[str, Verdicts], specs: Sequence[EpisodeSpec]) -> Iterator[str]:
    for mode in MODES:
        for verdict in ("success", "exact"):
            rate = Rate(sum(found[spec.name][mode][verdict] for spec in specs), len(specs))
            low, high = (100 * bound for bound in rate.interval)
            yield f"{rate.successes}/{rate.episodes} ({low:.0f}–{high:.0f} %)"


def main() -> None:
    """Plays, writes, prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", choices=get_args(Split), default="test")
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--tasks", default=",".join(ALL_TASKS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    asked = parser.parse_args()
    specs = [
        s for t in asked.tasks.split(",") for s in suite.episodes(t, asked.split, asked.episodes)
    ]
    found = measure(specs, asked.out, asked.workers)
    print(*table(found, specs), sep="\n")
    for name, verdicts in found.items():
        for mode, one in verdicts.items():
            if not one["exact"]:
                print(f"{name}, {mode}: {one['failure']}")


if __name__ == "__main__":
    main()
