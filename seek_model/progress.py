"""What a training tells while it runs: to who watches, to losses.jsonl, to TensorBoard."""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

PHASES = ("first", "second")
LOSSES = "losses.jsonl"
TENSORBOARD = "tensorboard"
RECENT = 50  # steps that a pace is measured over
DRAWN_EVERY = 20  # steps between two points in TensorBoard


@dataclass(frozen=True)
class Step:
    """One update, done."""

    phase: str
    step: int  # from 1
    steps: int  # of the phase
    losses: Mapping[str, float]
    samples_per_second: float  # frames that were supervised, or would have been without padding
    loader_share: float  # of the time, that was spent waiting for data
    seconds_left: float  # of the phase


class Watcher:
    """Told what happens; this one keeps it to itself."""

    def begun(self, phase: str, done: int, steps: int) -> None:
        """A phase begins, or goes on after `done` updates."""

    def stepped(self, step: Step) -> None:
        """An update is done."""

    def validated(self, phase: str, step: int, summary: Mapping[str, Any]) -> None:
        """A validation is done; `summary` as `validation.validate` returns it."""

    def say(self, line: str) -> None:
        """Something else that one should know."""


class Pace:
    """Samples a second, the loader's share, and what is left, over the latest steps."""

    def __init__(self, samples: int, steps: int):
        self._samples, self._steps = samples, steps
        self._ends: deque[float] = deque([monotonic()], maxlen=RECENT + 1)
        self._waits: deque[float] = deque(maxlen=RECENT)

    def step(self, waited: float) -> None:
        """A step ended; it waited so many seconds for its data."""
        self._ends.append(monotonic())
        self._waits.append(waited)

    def skip(self) -> None:
        """What happened since the last step does not count."""
        now = monotonic()
        gone = now - self._ends[-1]
        self._ends = deque((end + gone for end in self._ends), maxlen=RECENT + 1)

    @property
    def seconds(self) -> float:
        """That a step takes."""
        return (self._ends[-1] - self._ends[0]) / max(len(self._waits), 1)

    @property
    def samples_per_second(self) -> float:
        """Over the latest steps."""
        return self._samples / max(self.seconds, 1e-9)

    @property
    def loader_share(self) -> float:
        """0 to 1."""
        return min(sum(self._waits) / max(self._ends[-1] - self._ends[0], 1e-9), 1.0)

    def left(self, done: int) -> float:
        """Seconds to the last step."""
        return (self._steps - done) * self.seconds


class Journal:
    """A training's record on disk: a line of JSON for every step and validation."""

    def __init__(self, lines: Path, board: "SummaryWriter", offset: int):
        self._file = lines.open("a")
        self._board = board
        self._offset = offset  # steps of the phases before

    def step(self, step: Step) -> None:
        """Writes one row of kind `step`."""
        self._write(
            "step",
            step.phase,
            step.step,
            losses=dict(step.losses),
            samples_per_second=round(step.samples_per_second, 2),
            loader_share=round(step.loader_share, 3),
        )
        if step.step % DRAWN_EVERY == 0 or step.step == step.steps:
            told = {
                "samples_per_second": step.samples_per_second,
                "loader_share": step.loader_share,
            }
            self._draw(step.step, {**_under("loss", step.losses), **_under("pace", told)})

    def validation(self, phase: str, step: int, summary: Mapping[str, Any]) -> None:
        """Writes one row of kind `validation`."""
        self._write("validation", phase, step, **summary)
        for task, values in {"all": summary["overall"], **summary["tasks"]}.items():
            numbers = {name: value for name, value in values.items() if value is not None}
            self._draw(step, _under(f"validation/{task}", numbers))

    def flush(self) -> None:
        """All that was written is in the files."""
        self._file.flush()
        self._board.flush()

    def close(self) -> None:
        """Nothing more comes."""
        self._file.close()
        self._board.close()

    def _write(self, kind: str, phase: str, step: int, **values: Any) -> None:
        row = {"kind": kind, "phase": phase, "step": step, **values}
        self._file.write(json.dumps(row, allow_nan=False) + "\n")
        self._file.flush()  # who follows the file sees whole lines

    def _draw(self, step: int, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._board.add_scalar(name, value, self._offset + step)


def _under(folder: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{folder}/{name}": value for name, value in values.items()}


@contextmanager
def journal(folder: Path, phase: str, done: int, offset: int) -> Iterator[Journal]:
    """The journal of a phase that goes on after `done` steps; later rows of it are dropped.

    Args:
        folder: of the training.
        phase: its name.
        done: steps of it that stay.
        offset: steps of the phases before.
    """
    from torch.utils.tensorboard import SummaryWriter

    _forget(folder / LOSSES, phase, done)
    board = SummaryWriter(str(folder / TENSORBOARD), purge_step=offset + done + 1)
    opened = Journal(folder / LOSSES, board, offset)
    try:
        yield opened
    finally:
        opened.close()


def _forget(lines: Path, phase: str, done: int) -> None:
    """Drops the rows of steps that are trained again, and a row that was cut."""
    if not lines.exists():
        return
    kept = [line for line in lines.read_text().splitlines() if _stays(line, phase, done)]
    part = lines.with_name(lines.name + ".part")
    part.write_text("".join(f"{line}\n" for line in kept))
    part.replace(lines)


def _stays(line: str, phase: str, done: int) -> bool:
    try:
        row = json.loads(line)
    except ValueError:
        return False
    if row["phase"] == phase:
        return bool(row["step"] <= done)
    return PHASES.index(row["phase"]) < PHASES.index(phase)
