"""What training looks at: batches of sequences, whole episodes, and a loader that works ahead.

A batch is a function of (seed, phase, step): nothing has to be kept to resume.
"""

import itertools
import queue
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from types import TracebackType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from seek_model import recolor
from seek_model.augment import NONE, Placement, draw, inside
from seek_model.config import Augment, Phase, Train
from seek_model.frames import Frames, Targets
from seek_model.rotations import encode, six
from seek_model.store import Episode, Part, Store

FINGER = 0.04  # m of one finger's travel
AHEAD = 2  # batches that a loader keeps ready

Batch = tuple[Frames, Targets]


@dataclass(frozen=True)
class Cut:
    """Consecutive keyframes of one episode: an archive, then the supervised ones."""

    part: Part
    episode: Episode
    first: int  # decision with which the archive begins
    start: int  # decision with which supervision begins
    stop: int  # one past the last decision
    placement: Placement = NONE
    order: recolor.Order = recolor.SAME  # of its colours' channels

    @property
    def instruction(self) -> str:
        """As it is said of these colours."""
        return recolor.said(self.episode.instruction, self.order)

    @property
    def rows(self) -> slice:
        """In the part."""
        return slice(self.episode.first + self.first, self.episode.first + self.stop)

    def placed(self, config: Augment, rng: np.random.Generator) -> "Cut":
        """The same, shifted and turned such that every target stays in the cube, and recoloured."""
        placement = draw(rng, self.part.action_pose[self.rows, :3], config)
        order = recolor.draw(rng, self.episode.instruction) if config.colors else recolor.SAME
        return replace(self, placement=placement, order=order)


class Sampler:
    """Random sequences: a task and one of its episodes, each drawn uniformly, then a window.

    `phase.batch` counts the sequences of all processes; each has every `world`th of them, so the
    number of processes does not change what is learnt from.

    Raises:
        ValueError: the store lacks a task's training episodes, or the batch cannot be shared.
    """

    def __init__(
        self, store: Store, config: Train, phase: Phase, seed: int, rank: int = 0, world: int = 1
    ):
        if phase.batch % world:
            raise ValueError(f"A batch of {phase.batch} cannot be shared by {world} processes.")
        self.store, self.config, self.phase = store, config, phase
        self.tasks = _tasks(store, config.tasks)
        self.key = (seed, int(phase == config.second))
        self.elements = range(rank, phase.batch, world)
        self.archive = config.archive == "prefix" and phase.frames > 1

    def batch(self, step: int) -> Batch:
        """The sequences of a step, all with as many frames as the longest archive asks for."""
        cuts = [self.cut(step, element) for element in self.elements]
        archive = max(cut.start - cut.first for cut in cuts)
        return assembled(cuts, archive, self.phase.frames)

    def cut(self, step: int, element: int) -> Cut:
        """One sequence of a step's batch."""
        seed, phase = self.key
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(phase, step, element)))
        task = self.tasks[rng.integers(len(self.tasks))]
        episodes = self.store.episodes(task, "train")
        episode = episodes[rng.integers(len(episodes))]
        start, stop = self._window(episode.keyframes, rng)
        first = 0 if self.archive else start
        cut = Cut(self.store.part(task, "train"), episode, first, start, stop)
        return cut.placed(self.config.augment, rng)

    def _window(self, keyframes: int, rng: np.random.Generator) -> tuple[int, int]:
        """Consecutive decisions; one that would reach beyond an end is moved to it.

        Were all windows as likely, the last decision, where everything that was counted tells,
        would be in the fewest of them.
        """
        wanted = self.phase.frames
        start = int(rng.integers(1 - wanted, keyframes))
        start = min(max(start, 0), max(keyframes - wanted, 0))
        return start, min(start + wanted, keyframes)


def _tasks(store: Store, wanted: Sequence[str]) -> tuple[str, ...]:
    held = tuple(task for task in store.tasks if store.episodes(task, "train"))
    if missing := [task for task in wanted if task not in held]:
        raise ValueError(
            f"{store.path} has no train episodes of {', '.join(missing)}; "
            f"it has those of {', '.join(held) or 'no task'}."
        )
    if not held:
        raise ValueError(f"{store.path} has no train episodes.")
    return tuple(wanted) or held


# --- batches ------------------------------------------------------------------------------------

_GRIDS: dict[str, torch.dtype] = {
    "fingers": torch.float32,
    "pose": torch.float32,
    "decision": torch.int64,
    "present": torch.bool,
    "position": torch.float32,
    "rotation": torch.int64,
    "opening": torch.int64,
    "ignore_collisions": torch.int64,
    "stage": torch.int64,
    "boundary": torch.float32,
    "stop": torch.float32,
    "evidence": torch.int64,
    "supervised": torch.bool,
}
_PADDING = {"evidence": -1}  # 0 elsewhere


def assembled(cuts: Sequence[Cut], archive: int, window: int) -> Batch:
    """Sequences as tensors: archives end, and windows begin, at the same step.

    Args:
        cuts: one a sequence.
        archive: steps before the windows; shorter archives are padded in front.
        window: steps of the windows; shorter ones are padded at the end.
    """
    steps = archive + window
    begins = [archive - (cut.start - cut.first) for cut in cuts]
    values = [_values(cut) for cut in cuts]
    grids = {name: _grid(name, values, begins, steps) for name in _GRIDS}
    seen = ("fingers", "pose", "decision", "present")
    frames = Frames(
        **_clouds(cuts, begins, steps),
        instructions=[cut.instruction for cut in cuts],
        **{name: grids.pop(name) for name in seen},
    )
    return frames, Targets(**grids)


def _values(cut: Cut) -> dict[str, NDArray[Any]]:
    """What a sequence has in each grid, a row for every keyframe."""
    part, rows, place = cut.part, cut.rows, cut.placement
    pose, action = part.pose[rows], part.action_pose[rows]
    decision = part.decision[rows]
    return {
        "fingers": part.opening[rows, None] * [1.0, FINGER, FINGER],
        "pose": np.concatenate(
            [place.positions(pose[:, :3]), six(place.quaternions(pose[:, 3:]))], axis=1
        ),
        "decision": decision,
        "present": np.ones(len(decision), np.bool_),
        "position": place.positions(action[:, :3]),
        "rotation": encode(place.quaternions(action[:, 3:])),
        "opening": part.action_opening[rows] >= 0.5,
        "supervised": decision >= cut.start,
        **{
            name: getattr(part, name)[rows]
            for name in ("ignore_collisions", "stage", "boundary", "stop", "evidence")
        },
    }


def _grid(
    name: str, values: Sequence[dict[str, NDArray[Any]]], begins: Sequence[int], steps: int
) -> Tensor:
    width = values[0][name].shape[1:]
    grid = torch.full((len(values), steps, *width), _PADDING.get(name, 0), dtype=_GRIDS[name])
    for row, begin, value in zip(grid, begins, values, strict=True):
        row[begin : begin + len(value[name])] = torch.from_numpy(value[name])
    return grid


def _clouds(cuts: Sequence[Cut], begins: Sequence[int], steps: int) -> dict[str, Tensor]:
    """The points of all frames, their colours and owners; what left the cube is dropped."""
    firsts = [number * steps + begin for number, begin in enumerate(begins)]
    parts = [_seen(cut, first) for cut, first in zip(cuts, firsts, strict=True)]
    points, colors, owner = (torch.cat(tensors) for tensors in zip(*parts, strict=True))
    return {"points": points, "colors": colors.float() / 255, "owner": owner}


def _seen(cut: Cut, first: int) -> tuple[Tensor, ...]:
    """Points, colours and owners of one sequence whose frames are numbered from `first`."""
    points, colors, counts = cut.part.clouds(cut.rows)
    placed = cut.placement.points(torch.from_numpy(points))
    kept = inside(placed).nonzero()[:, 0]
    owner = torch.arange(first, first + len(counts)).repeat_interleave(torch.from_numpy(counts))
    seen = (placed, torch.from_numpy(recolor.seen(colors, cut.order)), owner)
    return tuple(tensor.index_select(0, kept) for tensor in seen)


# --- working ahead ------------------------------------------------------------------------------


class Loader:
    """Batches of a sampler from a step on, prepared by a thread while others are used.

    Endless. What goes wrong in the thread is raised where the batch is asked for. Close it, or
    use it in a `with`.
    """

    def __init__(self, sampler: Sampler, start: int):
        self.waited = 0.0  # s that the consumer waited for batches
        self._began = perf_counter()
        self._ready: queue.Queue[Batch | Exception] = queue.Queue(AHEAD)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._prepare, args=(sampler, start), daemon=True)
        self._thread.start()

    @property
    def share(self) -> float:
        """Of the time since the loader was made: spent waiting for batches, 0 to 1."""
        return self.waited / max(perf_counter() - self._began, 1e-9)

    def __iter__(self) -> "Loader":
        return self

    def __next__(self) -> Batch:
        if self._closed.is_set():
            raise StopIteration
        asked = perf_counter()
        batch = self._ready.get()
        self.waited += perf_counter() - asked
        if isinstance(batch, Exception):
            self.close()
            raise batch
        return batch

    def close(self) -> None:
        """Ends the thread; further batches are refused."""
        self._closed.set()
        self._thread.join()

    def __enter__(self) -> "Loader":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _prepare(self, sampler: Sampler, start: int) -> None:
        for step in itertools.count(start):
            try:
                batch: Batch | Exception = sampler.batch(step)
            except Exception as error:
                batch = error
            if not self._put(batch) or isinstance(batch, Exception):
                return

    def _put(self, batch: Batch | Exception) -> bool:
        """False once the loader is closed."""
        while not self._closed.is_set():
            try:
                self._ready.put(batch, timeout=0.05)
                return True
            except queue.Full:
                continue
        return False
