"""How many stages of the expert's script are done when the world is as it is: truth for counters.

What a policy counts is not among the hidden values, and the world's stage has one name for every
press. So the experts, detours included, played every history once; `stages.json` keeps how many
stages were done at each hidden state, and a reader needs no simulator. Several numbers at one
hidden state are all right: reaching the button, say, is a stage that changes nothing hidden.
"""

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from hide_tasks import ALL_TASKS, load, suite
from hide_tasks.contract import EpisodeSpec, HiddenState, Split, Value
from hide_tasks.sources import sources_hash

FILE = Path(__file__).with_suffix(".json")
SPLITS: tuple[Split, ...] = ("train", "val", "test")


def stages_done(
    task: str, variation: Mapping[str, Value], stage: str, hidden: HiddenState
) -> tuple[int, ...]:
    """How many stages may be done at this stage and hidden state; empty where no expert comes."""
    return _known(task, history(task, variation)).get(_moment(stage, hidden), ())


def history(task: str, variation: Mapping[str, Value]) -> str:
    """What of a variation changes more than looks, as a key."""
    looks = load(task).looks
    return json.dumps({name: value for name, value in variation.items() if name not in looks})


def read() -> dict[str, Any]:
    """By task: the sources' hash, and by history how many stages are done at which moments."""
    found: dict[str, Any] = json.loads(FILE.read_text())
    return found


@cache
def _known(task: str, key: str) -> dict[str, tuple[int, ...]]:
    moments = read()[task]["histories"].get(key, [])
    return {_moment(one["stage"], one["hidden"]): tuple(one["done"]) for one in moments}


def _moment(stage: str, hidden: HiddenState) -> str:
    return json.dumps([stage, hidden], sort_keys=True)


# --- measuring: only this part needs the simulator ---


def measured(task: str) -> dict[str, Any]:
    """What the file holds of a task."""
    histories = {key: moments(spec) for key, spec in examples(task).items()}
    return {"sources": sources_hash(task), "histories": histories}


def examples(task: str) -> dict[str, EpisodeSpec]:
    """An episode of every history."""
    found: dict[str, EpisodeSpec] = {}
    for split in SPLITS:
        for spec in suite.episodes(task, split, None):
            found.setdefault(history(task, spec.variation), spec)
    return dict(sorted(found.items()))


def moments(spec: EpisodeSpec) -> list[dict[str, Any]]:
    """How many stages were done at which moments, over the expert's script and all detours."""
    found: dict[str, dict[str, Any]] = {}
    detours = len(suite.build(spec).detours())
    for detour in (None, *range(detours)):
        for stage, hidden, done in _played(spec, detour):
            new = {"stage": stage, "hidden": hidden, "done": []}
            one = found.setdefault(_moment(stage, hidden), new)
            one["done"] = sorted({*one["done"], done})
    return list(found.values())


def _played(spec: EpisodeSpec, detour: int | None) -> Iterator[tuple[str, HiddenState, int]]:
    from hide_tasks.bullet.world import World
    from hide_tasks.script import steps

    number = 0
    with World(suite.build(spec)) as world:
        for step in steps(world.task, detour):
            number = step.number
            yield world.task.stage(), world.task.hidden_state(), number
            world.execute(step.keyframe)
        yield world.task.stage(), world.task.hidden_state(), number + 1


def main() -> None:
    """Write the file anew."""
    found = {task: measured(task) for task in ALL_TASKS}
    text = json.dumps(found, indent=1)
    FILE.write_text(re.sub(r"\n {4,}\s*", " ", text) + "\n")  # a history a line


if __name__ == "__main__":
    main()
