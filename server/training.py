"""Trains a model for somebody who watches standard error. torch is imported when it is needed."""

import fcntl
import multiprocessing
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from datetime import timedelta
from importlib.util import find_spec
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from seek_model.config import Config, Views
from seek_model.progress import Step, Watcher
from server.arguments import BadUsage
from server.progress import EVERY
from workers.engines.processes import prepare_process
from workers.evaluation import count_cpus

if TYPE_CHECKING:
    from seek_model.store import Store

LOCK = ".store.lock"
FEW = 20  # demonstrations
NEEDED = ("torch", "safetensors", "einops", "jaxtyping", "tokenizers", "tensorboard")


class TrainingFailed(Exception):
    """The training could not go on; the message tells why and what is kept."""


def train(
    recipe: str,
    data: Path,
    out: Path | None,
    *,
    resume: bool,
    steps_scale: float,
    seed: int | None = None,
    start: Path | None = None,
) -> Path:
    """Trains what a recipe tells, on a folder of demonstrations; the checkpoint's file.

    Args:
        recipe: a preset, or a TOML file that changes one.
        data: the folder of demonstrations.
        out: the training's folder; None for one that the name and the seed tell.
        resume: go on if there is a training of the same in `out`.
        steps_scale: times the steps of both phases.
        seed, start: in place of the recipe's.

    Raises:
        BadUsage: the recipe, the data or the folder cannot be used; nothing was trained.
        TrainingFailed: it began and cannot go on.
        KeyboardInterrupt: it was stopped, and its folder is in order.
    """
    require_torch()
    config = changed(configuration(recipe, steps_scale), seed, start)
    from seek_model.network import parameter_counts
    from seek_model.store import StoreError
    from seek_model.trainer import TrainingError
    from seek_model.training import train as run
    from seek_model.training_folder import TrainingFolderError

    folder = out or Path("runs", f"train-{name_of(config)}")
    with reporting() as reporter:
        reporter.name = f"{folder.name}, "
        try:
            store = keyframes(data, config.model.views, reporter)
            reporter.say(f"{folder}: {config.name} on {store.path}")
            reporter.say(size(parameter_counts(config.model)))
            return run(config, store.path, folder, resume, reporter)
        except (StoreError, TrainingFolderError) as error:
            raise BadUsage(str(error)) from None
        except TrainingError as error:
            raise TrainingFailed(str(error)) from None
        except KeyboardInterrupt:
            reporter.say(f"The same command with --out {folder} goes on.")
            raise


def require_torch() -> None:
    """Raises BadUsage, which tells what to install, if a package is missing."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise BadUsage(f"No package {missing[0]}. Install it with: pip install 'hide-seek[seek]'")


def configuration(recipe: str, steps_scale: float = 1.0) -> Config:
    """What a preset's name or a file tells, with so many times the steps.

    Raises:
        BadUsage: it cannot be followed.
    """
    from seek_model.recipes import BadRecipe, read, scaled

    try:
        config = read(recipe)
    except BadRecipe as error:
        raise BadUsage(str(error)) from None
    return scaled(config, steps_scale) if steps_scale != 1 else config


def changed(config: Config, seed: int | None, start: Path | None) -> Config:
    """The same training with another seed, or going on from a checkpoint.

    Raises:
        BadUsage: there is no such checkpoint.
    """
    changes: dict[str, object] = {} if seed is None else {"seed": seed}
    if start is not None:
        if not start.is_file():
            raise BadUsage(f"--start {start}: no such file; it takes a checkpoint of phase first.")
        changes["start"] = str(start)
    return config.model_copy(update={"train": config.train.model_copy(update=changes)})


def name_of(config: Config) -> str:
    """What a training is called on disk; every seed but 0 has a name of its own."""
    seed = config.train.seed
    return config.name.replace("/", "-") + f"-s{seed}" * (seed != 0)


def keyframes(data: Path, views: Views, reporter: "Reporter") -> "Store":
    """The keyframe store of a folder of demonstrations, for these views, in that folder.

    Several processes may ask at the same time; one of them builds.

    Raises:
        StoreError: the demonstrations cannot be used.
    """
    from hide_tasks.demos import DemosError, Folder
    from seek_model.store import StoreError, build

    try:
        Folder.open(data)
    except DemosError as error:
        raise StoreError(str(error)) from None
    out = data / f"keyframes-{views.points}-{views.voxel:g}"
    if not out.exists():
        reporter.say(f"Building {out}; this is done once.")
    with _locked(data / LOCK), _processes(data) as executor:
        return build(data, out, points=views.points, voxel=views.voxel, executor=executor)


@contextmanager
def _processes(data: Path) -> Iterator[ProcessPoolExecutor | None]:
    """To build with; a few files are read sooner than a process starts."""
    if sum(1 for _ in data.glob("*/*.npz")) < FEW:
        yield None
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count_cpus(), context, prepare_process) as executor:
        yield executor


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


# --- what is seen of it -------------------------------------------------------------------------


class Reporter(Watcher):
    """A plain line now and then, for a log."""

    def __init__(self, console: Console):
        self.console = console
        self.told = monotonic()
        self.name = ""  # of the training, for several lines of several trainings in one log

    def begun(self, phase: str, done: int, steps: int) -> None:
        self.say(f"Phase {phase}: {steps - done} steps to train" + f", {done} there" * bool(done))

    def stepped(self, step: Step) -> None:
        if step.step == step.steps or monotonic() - self.told > EVERY:
            self.told = monotonic()
            self.say(f"{self.name}{step.phase}: {step.step} of {step.steps} steps, {pace(step)}")

    def validated(self, phase: str, step: int, summary: Mapping[str, Any]) -> None:
        self.say(f"{self.name}{phase}, step {step}: {told(summary['overall'])}")

    def say(self, line: str) -> None:
        self.console.print(line, markup=False, highlight=False, soft_wrap=True)


class Bar(Reporter):
    """A bar that stays in place, for a terminal."""

    def __init__(self, console: Console, progress: Progress):
        super().__init__(console)
        self.progress = progress
        self.row = progress.add_task("", total=None, pace="", visible=False)

    def begun(self, phase: str, done: int, steps: int) -> None:
        super().begun(phase, done, steps)
        self.progress.update(self.row, total=steps, completed=done, visible=done < steps)

    def stepped(self, step: Step) -> None:
        self.progress.update(self.row, completed=step.step, pace=pace(step))


def size(counts: Mapping[str, int]) -> str:
    """Parameters of a network and of its parts."""
    parts = ", ".join(f"{name} {count / 1e6:.2f}" for name, count in counts.items())
    return f"{sum(counts.values()) / 1e6:.2f} million parameters: {parts}"


def pace(step: Step) -> str:
    """Samples a second, what waits for data, time left, and the loss."""
    left = timedelta(seconds=round(step.seconds_left))
    return (
        f"{step.samples_per_second:.1f} samples/s, {100 * step.loader_share:.0f} % waiting for "
        f"data, {left} left, loss {step.losses['total']:.3f}"
    )


def told(summary: Mapping[str, Any]) -> str:
    """A validation in one line."""
    if not summary["frames"]:
        return "no episodes of split val to validate on"
    line = (
        f"{summary['position_cm']:.1f} cm off in {summary['frames']} keyframes of split val, "
        f"{100 * summary['position_near']:.0f} % under 2 cm, "
        f"{summary['rotation_degrees']:.0f} degrees"
    )
    if summary["own_count"] is not None:
        line += f", own count right in {100 * summary['own_count']:.0f} %"
    return line


class _Silent(Reporter):
    """For the processes of a group that do not write."""

    def say(self, line: str) -> None:
        pass


@contextmanager
def reporting() -> Iterator[Reporter]:
    """A reporter that suits standard error; of a group of processes only the first speaks."""
    console = Console(stderr=True)
    if os.environ.get("RANK", "0") != "0":
        yield _Silent(console)
    elif not console.is_terminal:
        yield Reporter(console)
    else:
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
        with Progress(*columns, console=console) as progress:
            yield Bar(console, progress)
