"""An expert's script as keyframes, and the script points of an episode and its twins."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import EpisodeSpec, HiddenState, Keyframe, Observation, Variation
from hide_tasks.task import Move, Stage, Task


class Step(NamedTuple):
    """A keyframe of a script and the stage that it belongs to."""

    number: int  # of the stage, from 0; a name may come again
    stage: str
    within: int  # keyframes of the stage before it
    keyframe: Keyframe


def steps(task: Task, detour: int | None = None) -> Iterator[Step]:
    """The keyframes of the expert, or of a detour, with their stages; the last one says stop.

    A keyframe is read when it is asked for, so the one before must have been carried out.
    """
    moves = _moves(task.expert() if detour is None else task.detours()[detour])
    number, name, within, move = next(moves)
    for following in moves:
        yield Step(number, name, within, move())
        number, name, within, move = following
    yield Step(number, name, within, move().model_copy(update={"stop": True}))


def script(task: Task, detour: int | None = None) -> Iterator[tuple[str, Keyframe]]:
    """The same as stages' names and keyframes."""
    return ((step.stage, step.keyframe) for step in steps(task, detour))


def _moves(stages: Iterator[Stage]) -> Iterator[tuple[int, str, int, Move]]:
    return (
        (number, stage.name, within, move)
        for number, stage in enumerate(stages)
        for within, move in enumerate(stage.moves)
    )


@dataclass(frozen=True)
class Point:
    """A moment of an expert's episode: what is seen, what comes next, and why."""

    script: int  # which of the scripts of the episode and its twins
    keyframes: int  # how many are done
    observation: Observation
    next: Keyframe
    stage: str  # the stage that the next keyframe belongs to
    within: int  # keyframes of that stage that are done
    hidden: HiddenState


def twins(spec: EpisodeSpec) -> list[Variation]:
    """The variations that fit the instruction and the looks: all values of the hidden axes."""
    axes = type(suite.build(spec)).hidden_axes()
    return [
        {**spec.variation, **dict(zip(axes, values, strict=True))}
        for values in itertools.product(*axes.values())
    ]


def points(spec: EpisodeSpec, number: int = 0, detour: int | None = None) -> list[Point]:
    """The expert's episode of a spec, point by point; a last observation has no point."""
    found = []
    with World(suite.build(spec)) as world:
        for done, step in enumerate(steps(world.task, detour)):
            seen, hidden = world.observe(), world.task.hidden_state()
            found.append(Point(number, done, seen, step.keyframe, step.stage, step.within, hidden))
            world.execute(step.keyframe)
    return found


def library(spec: EpisodeSpec) -> list[Point]:
    """The script points of an episode and of all its twins, detours last."""
    specs = [spec.twin(variation) for variation in twins(spec)]
    detours = [(s, d) for s in specs for d in range(len(suite.build(s).detours()))]
    found = [points(s, number) for number, s in enumerate(specs)]
    found += [points(s, len(specs) + i, d) for i, (s, d) in enumerate(detours)]
    return [point for one in found for point in one]


def same_action(a: Keyframe, b: Keyframe) -> bool:
    """True when two keyframes lead to the same place with the same fingers, and end alike."""
    apart = float(np.linalg.norm(a.pose[:3] - b.pose[:3]))
    aligned = abs(float(a.pose[3:] @ b.pose[3:]))
    alike = (a.opening >= 0.5) == (b.opening >= 0.5) and a.stop == b.stop
    return apart < 0.01 and aligned > 0.99 and alike
