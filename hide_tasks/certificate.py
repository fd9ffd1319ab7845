"""Proves, for one task, what its score means: `hide certify`.

Three parts: pairs of moments that look the same and call for different actions, verified on real
episodes; the ceiling of a perfect policy without memory, computed and measured; a probe that
tries to read the next action from the picture. The result is committed, one file a task.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import Any, TypeVar

import numpy as np

from hide_tasks import load, suite
from hide_tasks.adversaries import CHOOSERS, StopsAtOnce
from hide_tasks.amnesiac import Amnesiac, Mix, signature
from hide_tasks.automaton import Automaton, Verdict, explore
from hide_tasks.bullet.world import World
from hide_tasks.choices import Choices
from hide_tasks.contract import EpisodeResult, EpisodeSpec, Variation
from hide_tasks.episode import play
from hide_tasks.likeness import likeness
from hide_tasks.mixing import best_mix
from hide_tasks.probe import Sample, probe
from hide_tasks.script import Point, library, points, same_action, script, twins
from hide_tasks.sources import ROOT, sources_hash
from hide_tasks.statistics import Rate
from hide_tasks.task import Moment, Task

ALIAS_EPISODES = 10  # of the train split on which every declared pair is verified
ROLLS = 4  # per test episode: 100 plays tell chance from a leak better than 25
STRONG = 0.70  # exact ceiling up to which a task is strong: three in ten are lost without memory
VERDICTS: tuple[Verdict, ...] = ("success", "exact")

T = TypeVar("T")


def certify(task: str, executor: Executor | None = None) -> dict[str, Any]:
    """The certificate of a task as a document; also written to the package's data.

    `executor` spreads the episodes over processes.
    """
    spread: Callable[..., Iterable[Any]] = executor.map if executor else map
    aliases = _merged(list(spread(alias_report, suite.episodes(task, "train", ALIAS_EPISODES))))
    groups = _groups(task)
    explored = list(spread(ceiling_of, [specs[0] for specs in groups.values()]))
    mixes = {one["signature"]: one["mix"] for one in explored}
    ceilings = _weighted(explored, [len(specs) for specs in groups.values()])
    specs = suite.episodes(task, "test")
    rounds = list(spread(play_without_memory, specs, [mixes] * len(specs)))
    played = {name: [r for one in rounds for r in one[name]] for name in rounds[0]}
    samples = [s for found in spread(samples_of, suite.episodes(task, "train")) for s in found]
    document: dict[str, Any] = {
        "task": task,
        "sources": sources_hash(task, certified=True),
        "aliases": aliases,
        "ceilings": ceilings,
        "mixes": mixes,
        "amnesiac": _measured(played.pop("amnesiac")),
        "adversaries": {name: _measured(results) for name, results in played.items()},
        "probe": probe(samples),
    }
    document["verdict"], document["reason"] = judge(document)
    path = ROOT / "certificates" / f"{task}.json"
    path.write_text(json.dumps(document, indent=1) + "\n")
    return document


def judge(document: dict[str, Any]) -> tuple[str, str]:
    """Strong or weak, and why in one sentence."""
    ceiling = document["ceilings"]["exact"]
    report = document["probe"]
    if not document["aliases"]:
        return "weak", "No two moments that call for different actions look the same."
    if not all(alias["verified"] for alias in document["aliases"]):
        return "weak", "A declared pair of moments can be told apart or calls for one action."
    if ceiling > STRONG:
        return (
            "weak",
            f"Without memory the expert's keyframes are exact in {ceiling:.0%} of the episodes.",
        )
    if not report["blind"]:
        best = max(report[name]["high"] for name in ("nearest", "linear"))
        return "weak", (
            f"A classifier may read the next action from the picture at the alias points: its "
            f"interval ends at {best:.0%}, chance is {report['chance']:.0%}."
        )
    return "strong", (
        f"At the alias points the picture does not tell the next action, and whoever plays the "
        f"expert's keyframes without memory is exact in at most {ceiling:.0%} of the episodes."
    )


# --- alias pairs --------------------------------------------------------------------------------


def alias_report(spec: EpisodeSpec) -> list[dict[str, Any]]:
    """Every declared pair of an episode, measured."""
    known: dict[str, list[Point]] = {}

    def at(moment: Moment) -> Point:
        key = json.dumps(moment.twin, sort_keys=True)
        if key not in known:
            known[key] = points(spec.twin(moment.twin))
        return known[key][moment.keyframes]

    return [
        compared(alias.why, at(alias.first), at(alias.second))
        for alias in suite.build(spec).aliases()
    ]


def compared(why: str, first: Point, second: Point) -> dict[str, Any]:
    """What is to be said of a declared pair; it is verified if it holds for these two moments."""
    distance = likeness(first.observation, second.observation)
    return {
        "why": why,
        "pixels": {name: round(share, 6) for name, share in distance.pixels.items()},
        "joints": round(distance.joints, 9),
        "hidden": [first.hidden, second.hidden],
        "next": [_place(first), _place(second)],
        "verified": distance.alike
        and first.hidden != second.hidden
        and not same_action(first.next, second.next),
    }


def _place(point: Point) -> dict[str, Any]:
    return {"stage": point.stage, "position": [round(v, 4) for v in point.next.position]}


def _merged(reports: Sequence[Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """One entry per declared pair: an example and the worst distances over all episodes."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for report in reports:
        for pair in report:
            found[pair["why"]].append(pair)
    return [
        {
            **pairs[0],
            "pixels": {
                name: max(pair["pixels"][name] for pair in pairs) for name in pairs[0]["pixels"]
            },
            "joints": max(pair["joints"] for pair in pairs),
            "episodes": len(pairs),
            "verified": all(pair["verified"] for pair in pairs),
        }
        for pairs in found.values()
    ]


# --- ceilings -----------------------------------------------------------------------------------


def _key(spec: EpisodeSpec) -> str:
    """What of an episode's instruction decides the shape of its script."""
    task = load(spec.task)
    told = {axis: spec.variation[axis] for axis in task.told() if axis not in task.looks}
    return json.dumps(told, sort_keys=True)


def _groups(task: str) -> dict[str, list[EpisodeSpec]]:
    """The train episodes by the shape of their scripts."""
    groups: dict[str, list[EpisodeSpec]] = defaultdict(list)
    for spec in suite.episodes(task, "train"):
        groups[_key(spec)].append(spec)
    return dict(sorted(groups.items()))


def ceiling_of(spec: EpisodeSpec) -> dict[str, Any]:
    """The best odds and the probabilities that they reach, on one layout."""
    found = library(spec)
    budget = load(spec.task).budget()
    automata: list[Automaton] = [
        explore(spec.twin(variation), found, 2 * budget) for variation in twins(spec)
    ]
    best = {verdict: best_mix(automata, verdict, budget) for verdict in VERDICTS}
    return {
        "signature": signature(found),
        "mix": best["exact"][0],
        **{verdict: best[verdict][1] for verdict in VERDICTS},
    }


def _weighted(explored: Sequence[dict[str, Any]], weights: Sequence[int]) -> dict[str, float]:
    return {
        verdict: round(float(np.average([one[verdict] for one in explored], weights=weights)), 4)
        for verdict in VERDICTS
    }


def play_without_memory(spec: EpisodeSpec, mixes: dict[str, Mix]) -> dict[str, list[EpisodeResult]]:
    """One test episode: the amnesiac, as often as its dice are rolled, and every adversary."""
    choices = Choices(spec, library(spec))
    found: dict[str, list[EpisodeResult]] = {}
    for name, policy in {"amnesiac": Amnesiac(mixes), **_choosers()}.items():
        policy.know(spec, choices.points)
        found[name] = [choices.play(policy) for _ in range(ROLLS if name == "amnesiac" else 1)]
    return {**found, "stops_at_once": [play(spec, StopsAtOnce())[0]]}


def _choosers() -> dict[str, Amnesiac]:
    return {name: make() for name, make in CHOOSERS.items()}


def _measured(played: Sequence[EpisodeResult]) -> dict[str, Any]:
    report: dict[str, Any] = {"episodes": len(played)}
    for verdict in VERDICTS:
        rate = Rate(sum(getattr(result, verdict) for result in played), len(played))
        low, high = rate.interval
        report[verdict] = {"rate": rate.value, "low": round(low, 4), "high": round(high, 4)}
    failures = Counter(str(result.failure) for result in played if result.failure)
    return {**report, "failures": dict(sorted(failures.items()))}


# --- probe --------------------------------------------------------------------------------------


def samples_of(spec: EpisodeSpec) -> list[Sample]:
    """The alias points of an episode and its twins, each moment once."""
    groups = _groups_of(suite.build(spec))
    by_twin: dict[str, dict[int, int]] = defaultdict(dict)
    for (twin, count), group in groups.items():
        by_twin[twin][count] = group
    found = [_samples(spec, json.loads(twin), counts) for twin, counts in by_twin.items()]
    return [sample for samples in found for sample in samples]


def _groups_of(task: Task) -> dict[tuple[str, int], int]:
    """The declared moments by twin and number of keyframes; those that look alike share one."""
    groups: dict[tuple[str, int], int] = {}
    for number, alias in enumerate(task.aliases()):
        keys = [
            (json.dumps(m.twin, sort_keys=True), m.keyframes) for m in (alias.first, alias.second)
        ]
        joined = {groups[key] for key in keys if key in groups}
        groups.update(dict.fromkeys(keys, number))
        groups = {key: number if group in joined else group for key, group in groups.items()}
    return groups


def _samples(spec: EpisodeSpec, twin: Variation, groups: dict[int, int]) -> list[Sample]:
    found: dict[tuple[int, str], Sample] = {}  # the last moment of a label, so that labels balance
    with World(suite.build(spec.twin(twin))) as world:
        for done, (stage, keyframe) in enumerate(script(world.task)):
            if done in groups:
                seen = world.observe()
                found[groups[done], stage] = Sample(spec.index, groups[done], seen, stage)
            if done == max(groups):
                break
            world.execute(keyframe)
    return list(found.values())
