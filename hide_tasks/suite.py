"""Which episodes exist: an episode is a function of (suite version, task, split, index).

The committed file of a task holds, for every episode, which layout draw its expert could solve
and the hash of its scene.
"""

import hashlib
import json
import math
from functools import lru_cache
from importlib.resources import files
from typing import Any, get_args

import numpy as np

from hide_tasks.catalogue import load, suite_of
from hide_tasks.contract import CONTROL_HZ, EpisodeSpec, Split
from hide_tasks.task import Grid, Task

SUITE = "hide"  # the paper's benchmark, meant where no suite is named
VERSION = 1  # of every suite
SPLITS: dict[Split, int] = {"train": 100, "val": 25, "test": 25, "test100": 100}


def _number(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def _generator(task: str, split: str, *key: int) -> np.random.Generator:
    spawn = (_number(suite_of(task)), VERSION, _number(task), _number(split), *key)
    return np.random.default_rng(np.random.SeedSequence(0, spawn_key=spawn))


@lru_cache(maxsize=64)
def _variations(task: str, split: Split) -> list[dict[str, Any]]:
    return Grid(**load(task).axes()).balanced(SPLITS[split], _generator(task, split))


@lru_cache(maxsize=64)
def committed(task: str) -> dict[str, Any]:
    """What `make gates` committed of a task's episodes; empty before its first run.

    `splits` holds for each split the lists `draws`, `scene_hashes`, `final_state_hashes`, and the
    expert's `keyframes` and simulated `seconds`.
    """
    file = files("hide_tasks").joinpath("episodes", f"{task}.json")
    return dict(json.loads(file.read_text())) if file.is_file() else {}


def row_budget(task: str) -> int:
    """How many 20 Hz rows of dense actions an episode may take: 1.5 times the longest expert.

    A minute's worth before the task is gated.
    """
    longest: float = committed(task).get("longest_seconds", 40.0)
    return math.ceil(1.5 * longest * CONTROL_HZ)


def episode(task: str, split: Split, index: int) -> EpisodeSpec:
    """The spec of one episode.

    Raises:
        UnknownTask: there is no such task.
        ValueError: there is no such split or index.
    """
    load(task)
    if split not in SPLITS:
        raise ValueError(f"No split '{split}'. Splits: {', '.join(get_args(Split))}.")
    if not 0 <= index < SPLITS[split]:
        raise ValueError(f"No episode {index} in {split}: it has 0 to {SPLITS[split] - 1}.")
    draws = committed(task).get("splits", {}).get(split, {}).get("draws", [])
    return EpisodeSpec(
        suite=suite_of(task),
        version=VERSION,
        task=task,
        split=split,
        index=index,
        variation=_variations(task, split)[index],
        draw=draws[index] if index < len(draws) else 0,
    )


def episodes(task: str, split: Split, count: int | None = None) -> list[EpisodeSpec]:
    """The first `count` episodes of a split, or all."""
    total = SPLITS.get(split, 1)  # an unknown split is told by `episode`
    return [episode(task, split, i) for i in range(total if count is None else min(count, total))]


def build(spec: EpisodeSpec) -> Task:
    """The task instance of an episode; its layout does not depend on the variation.

    Raises:
        UnknownTask: there is no such task.
        ValueError: this build does not know the suite's version, the episode or the variation.
    """
    _require_known(spec)
    rng = _generator(spec.task, spec.split, 1, spec.index, spec.draw)
    return load(spec.task)(spec.variation, rng)


def _require_known(spec: EpisodeSpec) -> None:
    known = suite_of(spec.task)
    if (spec.suite, spec.version) != (known, VERSION):
        raise ValueError(
            f"No {spec.task} in suite {spec.suite} v{spec.version}: "
            f"this build knows it in {known} v{VERSION} alone."
        )
    episode(spec.task, spec.split, spec.index)
    axes = load(spec.task).axes()
    if spec.variation.keys() != axes.keys():
        given, chosen = ", ".join(spec.variation) or "nothing", ", ".join(axes) or "nothing"
        raise ValueError(f"A variation of {spec.task} chooses {chosen}; given: {given}.")
    for axis, value in spec.variation.items():
        if value not in axes[axis]:
            values = ", ".join(map(str, axes[axis]))
            raise ValueError(f"No {axis} '{value}' in {spec.task}: there are {values}.")


def policy_seed(spec: EpisodeSpec) -> int:
    """An opaque number of 53 bits that tells a policy nothing but lets it be random repeatably."""
    return int(_generator(spec.task, spec.split, 2, spec.index).integers(2**53))


def scene_hash(spec: EpisodeSpec) -> str:
    """SHA-256 of the quantised scene; the same on every machine."""
    task = build(spec)
    return task.layout.scene_hash(task.instruction)
