"""Episodes that are played again, and what must come out."""

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from server.verification.findings import Findings
from workers.engines.local import LocalEngine, Lost
from workers.evaluation import EPISODE_LIMIT, WORKERS_LOG
from workers.resimulation import Recorded, Resimulated, resimulate

Thing = TypeVar("Thing")
ANYWHERE = ("success", "exact", "failure", "decisions", "instruction", "scene_hash")
ON_ITS_MACHINE = (*ANYWHERE, "stage", "final_state_hash")


@dataclass(frozen=True)
class Replay:
    """An episode to be played again, and what is stored of it."""

    recorded: Recorded
    name: str
    result: dict[str, Any]
    decisions: list[dict[str, Any]]
    changes: list[dict[str, Any]] | None  # None: they are not kept
    same_machine: bool  # of the class that played it


def sampled(things: Sequence[Thing], most: int | None) -> list[Thing]:
    """So many of them at random, which nobody can foresee; None: all."""
    if most is None or most >= len(things):
        return list(things)
    return random.SystemRandom().sample(things, most)


def play_again(
    replays: Sequence[Replay],
    findings: Findings,
    *,
    workers: int,
    done: Callable[[int], None] = lambda _: None,
) -> dict[str, Resimulated]:
    """Plays episodes in processes of their own and notes what comes out otherwise.

    Args:
        done: told, as it goes on, how many were played.
    """
    by_key = {one.recorded.key: one for one in replays}
    played: dict[str, Resimulated] = {}
    for key, outcome in _outcomes(replays, workers):
        replay = by_key[key]
        if isinstance(outcome, Resimulated):
            played[key] = outcome
            _compare(replay, outcome, findings)
        else:
            findings.note(key, replay.name, "simulation", "an episode", outcome)
        done(len(played))
    return played


def _outcomes(replays: Sequence[Replay], workers: int) -> Iterator[tuple[str, Resimulated | str]]:
    if not replays:
        return
    with TemporaryDirectory(prefix="hide-verify-") as folder:
        engine = LocalEngine(
            resimulate,
            workers=min(workers, len(replays)),
            time_limit=EPISODE_LIMIT,
            log=Path(folder) / WORKERS_LOG,
        )
        with closing(engine.run([one.recorded for one in replays])) as outcomes:
            for outcome in outcomes:
                if not isinstance(outcome, Lost):
                    yield outcome.job.key, outcome.result
                elif outcome.final:
                    yield outcome.job.key, outcome.reason


def _compare(replay: Replay, played: Resimulated, findings: Findings) -> None:
    findings.simulated += 1
    findings.bitwise += replay.same_machine
    key, name = replay.recorded.key, replay.name
    found = played.result.model_dump(mode="json")
    compared = ON_ITS_MACHINE if replay.same_machine else ANYWHERE
    stored = {f"{field}, played again": replay.result[field] for field in compared}
    findings.expect(key, name, stored, {f"{field}, played again": found[field] for field in found})
    if not replay.same_machine:
        return
    _compare_lists(replay, "decision", replay.decisions, played.decisions, findings)
    if replay.changes is not None:
        _compare_lists(replay, "hidden state", replay.changes, played.changes, findings)


def _compare_lists(
    replay: Replay, what: str, stored: list[dict[str, Any]], played: Any, findings: Findings
) -> None:
    """Notes the first of two lists of documents that differ; what a policy believed is its own."""
    found = [one.model_dump(mode="json") for one in played]
    for number, (was, now) in enumerate(zip(stored, found, strict=False)):
        fields = [one for one in was if one != "belief" and one in now and was[one] != now[one]]
        for field in fields:
            label = f"{what} {number}: {field}, played again"
            findings.note(replay.recorded.key, replay.name, label, was[field], now[field])
        if fields:
            return
