"""Training: the memory-free policy first, then memory on whole sequences (paper, appendix).

Every update is a function of its number, of the configuration and of the data: batches, dropout
and noise are drawn from generators seeded by the step. A training that is killed and goes on
therefore takes the same steps as one that is not (on one machine, with as many threads).
"""

import math
import os
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from time import monotonic

import torch

from seek_model import checkpoint, sampling, training_folder
from seek_model.checkpoint_header import Provenance
from seek_model.config import Config, Views
from seek_model.distributed import Group, joined
from seek_model.progress import PHASES, Journal, Pace, Step, Watcher, journal
from seek_model.starts import started
from seek_model.stopping import asked_to_stop
from seek_model.store import Store, StoreError
from seek_model.trainer import Trainer, TrainingError
from seek_model.training_folder import CHECKPOINT, CHECKPOINT_FIRST
from seek_model.validation import Precision, validate, whole_episodes


def train(
    config: Config, store: Path, out: Path, resume: bool = True, watch: Watcher | None = None
) -> Path:
    """Trains both phases; the checkpoint of the averaged weights at the very last step.

    No checkpoint is ever chosen by how well it does. Under torchrun every process calls this, and
    the first of them writes.

    Args:
        config: what and how.
        store: a keyframe store, made with the points and voxels of `config.model.views`.
        out: the training's folder: `config.json`, `losses.jsonl`, `tensorboard/`, `state.pt`,
            `checkpoint-first.safetensors` (the memory-free policy) and `checkpoint.safetensors`.
        resume: go on if there is a training of the same in `out`.
        watch: is told what happens.

    Raises:
        StoreError: the store cannot be used, lacks a task, or is of other points or voxels.
        TrainingFolderError: `out` holds something else.
        TrainingError: the network cannot be made, or a loss is no longer finite.
        KeyboardInterrupt: Ctrl-C or SIGTERM; the training is saved and can go on.
    """
    with prepared(config, store, out, resume, watch or Watcher()) as run:
        return run.train()


@contextmanager
def prepared(
    config: Config, store: Path, out: Path, resume: bool, watch: Watcher
) -> Iterator["Run"]:
    """A training of which everything is checked and nothing is done; arguments as of `train`."""
    _use_all_cores()
    data = Store.open(store)
    _require_same_clouds(data, config.model.views)
    with joined() as group, ExitStack() as stack:
        _require_episodes(data, config, group)
        stop = stack.enter_context(asked_to_stop())
        if group.first:
            about = {"suite": data.index.suite, "version": data.index.version, "hash": data.digest}
            stack.enter_context(training_folder.opened(out, config, about, resume))
        yield Run(config, data, out, group, watch, stop)


class Run:
    """One training in one process of its group; `trainer` is the phase it is in."""

    trainer: Trainer
    start = ""  # SHA-256 of the checkpoint that it goes on from

    def __init__(
        self,
        config: Config,
        data: Store,
        out: Path,
        group: Group,
        watch: Watcher,
        stop: threading.Event,
    ):
        self.config, self.data, self.out = config, data, out
        self.group, self.watch, self.stop = group, watch, stop
        self.precision = Precision(group.device, config.train.precision == "bf16")
        self.trained = 0.0  # seconds before this start
        self.began = self.saved = monotonic()

    def train(self) -> Path:
        """All phases that there are, from where the folder's state stands."""
        state = training_folder.kept(self.out, self.group.device)
        self.group.wait()  # nobody writes before all have read
        self.trained = state["seconds"] if state else 0.0
        phases, before = _phases(self.config), None
        if state:
            self.start = state.get("start", "")
        elif self.config.train.start:
            before, self.start = started(Path(self.config.train.start), self.config)
        for name in phases[phases.index(state["phase"]) if state else 0 :]:
            self.trainer = Trainer(name, self.config, self.group, before)
            if state:
                self.trainer.restore(state)
                state = None
            self._train()
            before = self.trainer.averaged
            self._finish(last=name == phases[-1])
        return self.out / CHECKPOINT

    def _train(self) -> None:
        trainer, phase = self.trainer, self.trainer.phase
        seed, (rank, world, _) = self.config.train.seed, self.group
        sampler = sampling.Sampler(self.data, self.config.train, phase, seed, rank, world)
        self.watch.begun(trainer.name, trainer.step, phase.steps)
        pace = Pace(phase.batch * phase.frames, phase.steps)
        with ExitStack() as stack:
            loader = stack.enter_context(sampling.Loader(sampler, trainer.step))
            told = stack.enter_context(self._journal()) if self.group.first else None
            while trainer.step < phase.steps:
                waited = loader.waited
                frames, targets = next(loader)
                values = trainer.update(frames, targets, self.precision, self.stop.is_set())
                stopping = values.pop("stopping") > 0
                pace.step(loader.waited - waited)
                _require_finite(values, trainer)
                if told:
                    self._tell(values, pace, told)
                    self._validate_or_save(pace, told)
                if stopping or self._alone_and_asked():
                    self._stop()

    def _journal(self) -> AbstractContextManager[Journal]:
        second = self.trainer.name == PHASES[1]
        offset = self.config.train.first.steps if second else 0
        return journal(self.out, self.trainer.name, self.trainer.step, offset)

    def _tell(self, values: dict[str, float], pace: Pace, told: Journal) -> None:
        step = Step(
            phase=self.trainer.name,
            step=self.trainer.step,
            steps=self.trainer.phase.steps,
            losses=values,
            samples_per_second=pace.samples_per_second,
            loader_share=pace.loader_share,
            seconds_left=pace.left(self.trainer.step),
        )
        told.step(step)
        self.watch.stepped(step)

    def _validate_or_save(self, pace: Pace, told: Journal) -> None:
        settings, done = self.config.train, self.trainer.step
        last = done == self.trainer.phase.steps
        if settings.validate_episodes and (last or not done % settings.validate_every):
            self._validate(told)
            pace.skip()
        if last or monotonic() - self.saved > settings.save_every:
            told.flush()
            self._save()
            pace.skip()

    def _validate(self, told: Journal) -> None:
        name, step = self.trainer.name, self.trainer.step
        episodes = whole_episodes(self.data, self.config.train)
        summary = validate(self.trainer.mean, episodes, self.precision)
        told.validation(name, step, summary)
        self.watch.validated(name, step, summary)

    def _save(self) -> None:
        about = {"seconds": self._seconds(), "start": self.start}
        training_folder.keep(self.out, self.trainer.state() | about)
        self.saved = monotonic()

    def _alone_and_asked(self) -> bool:
        """Asked during the step; a group first has to agree on it, in its next step."""
        return self.group.world == 1 and self.stop.is_set()

    def _stop(self) -> None:
        if self.group.first:
            self._save()
            step, name = self.trainer.step, self.trainer.name
            self.watch.say(f"Stopped after step {step} of phase {name}; it can go on from there.")
        raise KeyboardInterrupt

    def _seconds(self) -> float:
        return self.trained + monotonic() - self.began

    def _finish(self, last: bool) -> None:
        """Writes what a phase leaves behind, unless it did so before."""
        trainer = self.trainer
        names = [CHECKPOINT_FIRST] * (trainer.name == PHASES[0]) + [CHECKPOINT] * last
        missing = [name for name in names if not (self.out / name).exists()]
        if not self.group.first or not missing:
            return
        provenance = Provenance(
            project=version("hide-seek"),
            torch=torch.__version__,
            suite=self.data.index.suite,
            version=self.data.index.version,
            data=self.data.digest,
            tasks=self.config.train.tasks or self.data.tasks,
            phase=trainer.name,
            step=trainer.step,
            seed=self.config.train.seed,
            seconds=round(self._seconds(), 1),
            start=self.start,
        )
        for name in missing:
            checkpoint.save(self.out / name, trainer.averaged, trainer.config, provenance)


def _phases(config: Config) -> list[str]:
    """Those that are trained.

    A model without memory has a second phase only if it goes on from a checkpoint: the same
    updates as those of a model with memory, to compare it with.
    """
    first, second = PHASES
    phases = [first] * (not config.train.start and config.train.first.steps > 0)
    if config.train.second.steps and (config.model.memory or config.train.start):
        phases.append(second)
    if config.train.start and not phases:
        raise TrainingError(
            "train.start leaves the first phase out, and there is no second: "
            "it needs train.second.steps over 0."
        )
    if not phases:
        raise TrainingError("Nothing to train: train.first.steps is 0, and there is no second.")
    return phases


def _require_same_clouds(data: Store, views: Views) -> None:
    for name in ("points", "voxel"):
        there, wanted = getattr(data.index, name), getattr(views, name)
        if there != wanted:
            raise StoreError(
                f"{data.path} was built with {name} = {there}, but model.views.{name} = {wanted}. "
                "Build a store of its own for these views."
            )


def _require_episodes(data: Store, config: Config, group: Group) -> None:
    seed = config.train.seed
    for name in _phases(config):
        phase = getattr(config.train, name)
        try:
            sampling.Sampler(data, config.train, phase, seed, group.rank, group.world)
        except ValueError as error:
            raise StoreError(str(error)) from None


def _require_finite(values: dict[str, float], trainer: Trainer) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise TrainingError(
                f"{name} is {value} at step {trainer.step} of phase {trainer.name}; what was saved "
                "before is kept. A lower rate, more warm-up or precision fp32 may help."
            )


def _use_all_cores() -> None:
    if "OMP_NUM_THREADS" not in os.environ:
        torch.set_num_threads(os.cpu_count() or 1)
