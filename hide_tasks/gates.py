"""Every gate on every episode: `make gates`. The result is committed with a hash of the sources.

An episode passes when the expert succeeds exactly, in the paper's number of keyframes, and a
replay of its actions ends in the same state bit for bit. A layout that the expert cannot solve is
drawn again; the number of the accepted draw is committed.
"""

import argparse
import json
import logging
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from hide_tasks import ALL_TASKS, load, suite
from hide_tasks.contract import DecisionRecord, EpisodeResult, EpisodeSpec, Policy, Split
from hide_tasks.episode import play
from hide_tasks.machine import fingerprint
from hide_tasks.policies import Expert, Noop, Random, Replay
from hide_tasks.sources import ROOT, sources_hash

MOST_DRAWS = 20
IDLE_LIMIT = 0.04  # success rate of noop and random that is still near zero: 1 of 25

logger = logging.getLogger(__name__)


class GateError(RuntimeError):
    """A gate is shut; the message says which, on which episode."""


class Passed(NamedTuple):
    """What is committed of one episode."""

    draw: int
    scene_hash: str
    final_state_hash: str
    keyframes: int  # of the expert
    seconds: float  # simulated, of the expert


def solved(result: EpisodeResult, records: list[DecisionRecord]) -> bool:
    """True when an expert's episode is what its task promises."""
    in_paper = result.decisions in load(result.task).keyframes
    smooth = not any(record.outcome.failed or record.retried for record in records)
    return result.success and result.exact and in_paper and smooth


def accept(spec: EpisodeSpec) -> Passed:
    """The first draw of an episode that the expert solves and a replay repeats.

    Raises:
        GateError: no draw passes, or a replay ends elsewhere.
    """
    for draw in range(MOST_DRAWS):
        drawn = spec.model_copy(update={"draw": draw})
        result, records = play(drawn, Expert())
        if not solved(result, records):
            logger.info("%s: draw %d: %s", spec.name, draw, result.failure)
            continue
        again, _ = play(drawn, Replay([record.action for record in records]))
        if (again.exact, again.final_state_hash) != (True, result.final_state_hash):
            raise GateError(f"{spec.name}: the replay of draw {draw} ended elsewhere.")
        hashes = result.scene_hash, result.final_state_hash
        return Passed(draw, *hashes, result.decisions, records[-1].time)
    raise GateError(f"{spec.name}: the expert solved none of {MOST_DRAWS} draws.")


def idle(spec: EpisodeSpec) -> dict[str, bool]:
    """Whether doing nothing, and moving at random, succeeds."""
    policies: dict[str, Policy] = {"noop": Noop(), "random": Random()}
    return {name: play(spec, policy)[0].success for name, policy in policies.items()}


def gate(task: str, workers: int) -> dict[str, Any]:
    """Run a task's gates and write what is committed of it.

    Raises:
        GateError: a gate is shut.
    """
    suite.committed.cache_clear()
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        splits = {s: list(pool.map(accept, suite.episodes(task, s))) for s in suite.SPLITS}
        tests = [
            spec.model_copy(update={"draw": passed.draw})
            for spec, passed in zip(suite.episodes(task, "test"), splits["test"], strict=True)
        ]
        idles = list(pool.map(idle, tests))
    require_repeats(tests[::-1], splits["test"][::-1])
    rates = {name: sum(one[name] for one in idles) / len(idles) for name in idles[0]}
    if max(rates.values()) > IDLE_LIMIT:
        raise GateError(f"{task}: a policy that knows nothing succeeds: {rates}.")
    document = {**_document(task, splits), "idle_success": rates}
    _write(task, document)
    return document


def require_repeats(specs: Sequence[EpisodeSpec], passed: Sequence[Passed]) -> None:
    """Play experts again in one new process, in the order given.

    Raises:
        GateError: one ends in another state than it did before.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for spec, before, after in zip(specs, passed, pool.map(final_state, specs), strict=True):
            if after != before.final_state_hash:
                raise GateError(f"{spec.name} ended elsewhere in another process and order.")


def final_state(spec: EpisodeSpec) -> str:
    """The hash of the state in which the expert's episode ends."""
    return play(spec, Expert())[0].final_state_hash


def _document(task: str, splits: dict[Split, list[Passed]]) -> dict[str, Any]:
    return {
        "sources": sources_hash(task),
        "machine": fingerprint(),
        "longest_seconds": max(one.seconds for passed in splits.values() for one in passed),
        "splits": {split: _columns(passed) for split, passed in splits.items()},
    }


def _columns(passed: Iterable[Passed]) -> dict[str, list[Any]]:
    draws, scenes, finals, keyframes, seconds = zip(*passed, strict=True)
    return {
        "draws": list(draws),
        "scene_hashes": [value[:16] for value in scenes],
        "final_state_hashes": [value[:16] for value in finals],
        "keyframes": list(keyframes),
        "seconds": [round(value, 2) for value in seconds],
    }


def _write(task: str, document: dict[str, Any]) -> None:
    folder = ROOT / "episodes"
    folder.mkdir(exist_ok=True)
    Path(folder, f"{task}.json").write_text(json.dumps(document, indent=1) + "\n")


def main() -> int:
    """Run the gates of the named tasks, or of all."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("tasks", nargs="*", default=list(ALL_TASKS))
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    for task in arguments.tasks:
        document = gate(task, arguments.workers)
        draws = Counter(d for split in document["splits"].values() for d in split["draws"])
        logger.info("%s: every gate is open; draws %s", task, dict(sorted(draws.items())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
