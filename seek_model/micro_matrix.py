"""Trains a small network on the micro-tasks: with no memory, with each alone and with all three.

    python -m seek_model.micro_matrix --seeds 3 --out docs/micro_matrix.json

A cell is one training on the three tasks together. Its network then plays whole episodes, with
nothing but its own heat maps in memory and its own boundaries in the counter. Cells that the file
already holds are not trained again.
"""

import argparse
import json
import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from time import monotonic
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy.random import Generator
from pydantic import BaseModel
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from torch import Tensor

from seek_model import losses, optim
from seek_model.config import ConvFilm, Language, Memory, Model, Phase, Train, Views
from seek_model.micro_tasks import (
    CHANCE,
    TASKS,
    Cut,
    Episode,
    collate,
    draw,
    single_frames,
    training_batch,
)
from seek_model.network import Network

NEAR = 0.2  # cube, 10 cm: how far off a visible target may be; objects stand further apart
PLAYED = 100_000  # seed of the episodes that are played; none of training's

ALL = Memory(
    window=6, anchor="cosine", stages=16, channels=32, layers=2, feedforward=64, dropout=0.0,
    gate=False, colocation=True,
)  # fmt: skip
MEMORIES: dict[str, Memory | None] = {
    "none": None,
    "wcm": ALL.model_copy(update={"anchor": "none", "stages": 0}),
    "pam": ALL.model_copy(update={"window": 0, "stages": 0}),
    "scm": ALL.model_copy(update={"window": 0, "anchor": "none"}),
    "wcm+pam+scm": ALL,
}
# Other ways to read all three, to compare.
VARIANTS: dict[str, Memory | None] = {
    "all-colocation": ALL.model_copy(update={"colocation": False}),
    "all+gate": ALL.model_copy(update={"gate": True}),
}


Weights = dict[str, Tensor]


class Schedule(BaseModel):
    """How every cell is trained and played."""

    first: Phase = Phase(steps=500, horizon=500, warmup=20, batch=32, loss="coarse", rate=3e-3)
    second: Phase = Phase(
        steps=450, horizon=450, warmup=10, batch=24, frames=7, loss="coarse", rate=3e-3
    )
    tasks: tuple[str, ...] = tuple(TASKS)
    episodes: int = 100  # played, of each task


class Score(BaseModel):
    """What a network did in episodes of one task."""

    accuracy: float  # where memory decides: share of decisions nearest to the right candidate
    visible: float  # elsewhere: share of decisions near the target
    counted: float | None  # where memory decides: share of counts that are right
    retrieved: float | None  # where an anchor is needed: share that are the evidence


class Cell(BaseModel):
    """One training and what came of it."""

    memory: str
    seed: int
    scores: dict[str, Score]  # by task
    loss: float  # mean of the last steps
    seconds: float  # of training's second phase


class Matrix(BaseModel):
    """The file."""

    format: str = "hide-seek-micro-matrix 1"
    schedule: Schedule
    model: Model
    chance: dict[str, float]
    mean: dict[str, dict[str, float]] = {}  # accuracy by memory and task
    cells: list[Cell] = []


def model(memory: Memory | None) -> Model:
    """The small network of the matrix."""
    return Model(
        views=Views(size=16, points=16_384, voxel=0.008),
        backbone=ConvFilm(widths=(24, 48), channels=48, depth=1, heads=2),
        language=Language(channels=32, tokens=16),
        memory=memory,
    )


# --- one cell -----------------------------------------------------------------------------------


def see(seed: int, schedule: Schedule) -> Weights:
    """The first phase: from nothing, no memory, so that every step stands for itself."""
    torch.manual_seed(seed)
    network = Network(model(None))
    _run(network, np.random.default_rng((seed, 1)), schedule, schedule.first)
    return network.state_dict()


def remember(
    memory: Memory | None, seed: int, schedule: Schedule, seen: Weights
) -> tuple[Network, float]:
    """The second phase, with a memory, from what the first has seen; and the last steps' loss."""
    torch.manual_seed(seed)
    network = Network(model(memory))
    network.load_state_dict(seen, strict=False)
    loss = _run(network, np.random.default_rng((seed, 2)), schedule, schedule.second)
    return network.eval(), loss


def _run(network: Network, rng: Generator, schedule: Schedule, phase: Phase) -> float:
    """Trains for one phase; the mean loss of its last steps."""
    optimizer, settings, found = optim.optimizer(network, phase), Train(), []
    for step in range(phase.steps):
        batch = training_batch if phase.frames > 1 else single_frames
        frames, targets = batch(rng, phase.batch, schedule.tasks)
        predictions = network(frames, targets, coarse_only=True)
        loss = losses.total(predictions, targets, network, settings, phase)["total"]
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(optimizer.parameters(), phase.clip)
        optimizer.step(optim.rate(step, phase))
        found.append(loss.item())
    return float(np.mean(found[-50:]))


class Played(NamedTuple):
    """What a network said at every step of some episodes, ends in one column."""

    place: Float[Tensor, "e t 3"]
    done: Int[Tensor, "e t"]
    anchor: Int[Tensor, "e t"]  # the decision that was looked back at; -1: none


@torch.no_grad()
def play(network: Network, episodes: Sequence[Episode]) -> Played:
    """Whole episodes, each step with what the network itself remembers."""
    frames, _ = collate([Cut(one, 0, len(one.steps)) for one in episodes])
    archives = network.begin(len(episodes))
    place = torch.zeros(*frames.shape, 3)
    done, anchor = (torch.full(frames.shape, -1) for _ in range(2))
    for step in range(frames.shape[1]):
        said, pending = network.play(frames.between(step, step + 1), archives)
        rows = said.rows.sequence
        place[rows, step], done[rows, step] = said.coarse.target, said.coarse.done
        if said.coarse.recalled:
            found = said.coarse.recalled.slots.anchors
            anchor[rows, step] = torch.tensor([a.entry.decision if a else -1 for a in found])
        if pending:
            pending.commit()
    return Played(place, done, anchor)


def score(network: Network, episodes: Sequence[Episode]) -> Score:
    """How well it plays episodes of one task."""
    played = play(network, episodes)
    right, near, counted, retrieved = [], [], [], []
    for number, episode in enumerate(episodes):
        places, done, anchors = (part[number, -len(episode.steps) :].numpy() for part in played)
        stages = np.cumsum([0, *(step.boundary for step in episode.steps)])
        for t, step in enumerate(episode.steps):
            if step.choice < 0:
                near.append(np.linalg.norm(places[t] - step.target) < NEAR)
                continue
            off = np.linalg.norm(episode.candidates - places[t], axis=1)
            right.append(off.argmin() == step.choice)
            counted.append(done[t] == stages[t])
            retrieved.append(anchors[t] == step.evidence)
    settings, task = network.model.memory, episodes[0].task
    return Score(
        accuracy=float(np.mean(right)),
        visible=float(np.mean(near)),
        counted=float(np.mean(counted)) if settings and settings.stages else None,
        retrieved=float(np.mean(retrieved))
        if settings and settings.anchor != "none" and task == "cue"
        else None,
    )


def cell(name: str, seed: int, schedule: Schedule, seen: Weights) -> Cell:
    """Trains and plays one."""
    began = monotonic()
    network, loss = remember((MEMORIES | VARIANTS)[name], seed, schedule, seen)
    seconds = monotonic() - began
    rng = np.random.default_rng(PLAYED + seed)
    scores = {
        task: score(network, [draw(rng, task) for _ in range(schedule.episodes)])
        for task in schedule.tasks
    }
    return Cell(memory=name, seed=seed, scores=scores, loss=loss, seconds=seconds)


# --- all of them --------------------------------------------------------------------------------


def opened(path: Path, schedule: Schedule) -> Matrix:
    """The matrix in a file, or an empty one.

    Raises:
        SystemExit: the file was trained in another way.
    """
    empty = Matrix(schedule=schedule, model=model(ALL), chance=CHANCE)
    if not path.exists():
        return empty
    found = Matrix.model_validate_json(path.read_text())
    if found.model_copy(update={"cells": [], "mean": {}}) != empty:
        raise SystemExit(f"{path} was made with other settings; name another file or remove it")
    return found


def save(matrix: Matrix, path: Path) -> None:
    """Whole or not at all."""
    order = list(MEMORIES | VARIANTS)
    matrix.cells.sort(key=lambda one: (order.index(one.memory), one.seed))
    matrix.mean = {
        name: {task: round(_mean(matrix, name, task), 4) for task in matrix.schedule.tasks}
        for name in dict.fromkeys(one.memory for one in matrix.cells)
    }
    part = path.with_suffix(".part")
    part.write_text(json.dumps(matrix.model_dump(), indent=1) + "\n")
    os.replace(part, path)


def _mean(matrix: Matrix, name: str, task: str) -> float:
    return float(np.mean([c.scores[task].accuracy for c in matrix.cells if c.memory == name]))


def table(matrix: Matrix) -> Table:
    """Mean accuracy where memory decides, and each seed's."""
    drawn = Table("memory", *matrix.schedule.tasks, "visible", box=SIMPLE_HEAD)
    drawn.add_row("chance", *(f"{matrix.chance[task]:.0%}" for task in matrix.schedule.tasks), "")
    for name, means in matrix.mean.items():
        cells = [one for one in matrix.cells if one.memory == name]
        seeds = {t: " ".join(f"{100 * c.scores[t].accuracy:.0f}" for c in cells) for t in means}
        visible = np.mean([one.visible for c in cells for one in c.scores.values()])
        entries = (f"{mean:.0%} ({seeds[task]})" for task, mean in means.items())
        drawn.add_row(name, *entries, f"{visible:.0%}")
    return drawn


def _one_thread() -> None:
    torch.set_num_threads(1)


def fill(matrix: Matrix, wanted: Sequence[tuple[str, int]], path: Path, workers: int) -> None:
    """Trains the wanted cells that are missing, each in a process of one thread.

    The first phase is the same for all cells of a seed.
    """
    there = {(one.memory, one.seed) for one in matrix.cells}
    missing = [one for one in wanted if one not in there]
    progress, context = Console(stderr=True), multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_one_thread) as pool:
        seeds = sorted({seed for _, seed in missing})
        seen = {seed: pool.submit(see, seed, matrix.schedule) for seed in seeds}
        jobs = [
            pool.submit(cell, name, seed, matrix.schedule, seen[seed].result())
            for name, seed in missing
        ]
        for job in as_completed(jobs):
            one = job.result()
            matrix.cells.append(one)
            save(matrix, path)
            said = ", ".join(f"{task} {s.accuracy:.0%}" for task, s in one.scores.items())
            progress.print(
                f"{one.memory}, seed {one.seed}: {said}; {one.seconds:.0f} s", highlight=False
            )


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="Micro-tasks: every memory, several seeds.")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--memories", default=",".join(MEMORIES), help="names, by commas")
    given = parser.parse_args()
    matrix = opened(given.out, Schedule())
    names = given.memories.split(",")
    if unknown := set(names) - set(MEMORIES | VARIANTS):
        parser.error(f"no memory {sorted(unknown)}; all: {list(MEMORIES | VARIANTS)}")
    wanted = [(name, seed) for seed in range(given.seeds) for name in names]
    fill(matrix, wanted, given.out, given.workers)
    Console().print(table(matrix))


if __name__ == "__main__":
    main()
