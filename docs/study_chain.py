"""The study's steps in their folder: what is there, what is left, and how it is done."""

import argparse
import json
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

from docs import make_results, results_measured
from docs.own_processes import ROOT, Failed, Folder, server
from docs.results_measured import REFERENCES
from docs.study_player import Player, digest, say
from seek_model.checkpoint_header import BadCheckpoint, Header, read_header
from seek_model.study import Run, Study, is_of, recipe
from server.client import Client
from workers.evaluation import count_cpus

PLAYS = ("reference", "evaluation")
CHECKPOINT, CHECKPOINT_FIRST = "checkpoint.safetensors", "checkpoint-first.safetensors"


class Step(NamedTuple):
    """Something that is left to do."""

    kind: str  # whose seconds are known
    name: str
    do: Callable[[], None]


class Reproduction:
    """A study in its folder.

    Args:
        study: which one.
        options: as `docs.reproduce` reads them.

    Raises:
        Failed: a file that they name is not there.
        ValueError: a run that they name is none.
    """

    def __init__(self, study: Study, options: argparse.Namespace):
        if options.first and not options.first.is_file():
            raise Failed(f"--first {options.first}: no such file; it takes a checkpoint.")
        self.study, self.options = study, options
        self.out: Path = options.out
        self.demos: Path = options.demos or self.out / "demos"
        self.data: Path = self.out / "data"
        every = [*(run.name for run in study.runs), *REFERENCES]
        chosen = options.only.split(",") if options.only else every
        self.references = [name for name in REFERENCES if name in chosen]
        self.runs = [study.run(name) for name in chosen if name not in REFERENCES]
        self._timing = threading.Lock()

    def hold(self) -> None:
        """Keeps others from working in its folder, and waits for what was left behind there.

        Raises:
            Failed: somebody works there.
        """
        self.folder = Folder(self.out)

    # --- what is there ---

    def checkpoint(self, run: Run) -> Path:
        """A run's weights, be they there or not."""
        if not run.start and self.options.first:
            return self.options.first
        return self.out / "runs" / run.name / (CHECKPOINT if run.start else CHECKPOINT_FIRST)

    def trained(self, run: Run) -> bool:
        """True if a run's weights are there.

        Raises:
            Failed: they are of something else.
        """
        path = self.checkpoint(run)
        if not path.exists():
            return False
        try:
            header = read_header(path)
        except (BadCheckpoint, OSError) as error:
            raise Failed(f"{path} cannot be used: {error}") from None
        if run.start:
            self._require_of(run, path, header)
        return True

    def _require_of(self, run: Run, path: Path, header: Header) -> None:
        config = header.config
        if not is_of(run, config):
            raise Failed(
                f"{path} is of {config.name} with seed {config.train.seed}; {run.name} is "
                f"{run.preset} with seed {run.seed}, started from {run.start}."
            )
        start = self.checkpoint(self.study.run(run.start))
        if start.exists() and header.provenance.start != digest(start):
            raise Failed(
                f"{path} went on from other weights than {start}: remove {path.parent} to train "
                f"it again, or give the weights that it went on from (--first FILE)."
            )

    def steps(self) -> list[Step]:
        """What is left, in order.

        Raises:
            Failed: a run goes on from one that is neither there nor to be trained.
        """
        training = [run for run in self.runs if not self.trained(run)]
        for run in training:
            start = self.study.run(run.start) if run.start else None
            if start and start not in training and not self.trained(start):
                raise Failed(
                    f"{run.name} goes on from {start.name}, which is not there: train it as well "
                    f"(--only {start.name},{run.name}), or give its weights (--first FILE)."
                )
        steps = list(self._demonstrations()) if training else []
        steps += [
            Step("second" if run.start else "first", run.name, partial(self._train, run))
            for run in training
        ]
        return steps if self.options.train_only else steps + self._evaluations()

    def _demonstrations(self) -> Iterator[Step]:
        tasks = ("--tasks", ",".join(self.study.tasks)) if self.study.tasks else ()
        for split, episodes in self.study.demonstrations.items():
            count = ("--episodes", episodes) if episodes else ()
            arguments = ("demos", "--out", self.demos, "--split", split, *count, *tasks)

            yield Step(f"demonstrations of {split}", split, partial(self._hide, *arguments))

    def _hide(self, *arguments: str | Path | int) -> None:
        self.folder.hide(*arguments)

    def _train(self, run: Run) -> None:
        arguments: list[str | Path | int] = ["--data", self.demos, "--seed", run.seed]
        arguments += ["--out", self.out / "runs" / run.name]
        if run.start:
            start = self.checkpoint(self.study.run(run.start))
            arguments += ["--start", os.path.relpath(start, ROOT)]
        threads = self._threads if run.start else None
        self.folder.hide("train", self._recipe(run), *arguments, threads=threads)

    def _recipe(self, run: Run) -> str | Path:
        text = recipe(self.study, run)
        if text is None:
            return run.preset
        path = self.out / "recipes" / f"{run.name}.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    def _evaluations(self) -> list[Step]:
        there = results_measured.read(self.study, self.data)
        steps = [
            Step("reference", name, partial(self._play, name))
            for name in self.references
            if name not in there
        ]
        for run in self.runs:
            if run.start and not self._counts(run, there):
                steps.append(Step("evaluation", run.name, partial(self._play_run, run)))
        return steps

    def _play(self, name: str) -> None:
        self.player.play(name, name)

    def _play_run(self, run: Run) -> None:
        self.player.play_run(run, self.checkpoint(run))

    def _counts(self, run: Run, there: dict[str, results_measured.Record]) -> bool:
        """True if what was measured is of the weights that are there."""
        path = self.checkpoint(run)
        found = there.get(run.name)
        return bool(found and path.exists() and found["sha256"] == digest(path))

    # --- what is done ---

    def do(self, steps: list[Step]) -> None:
        """All of it; a server of its own runs for the evaluations, and to export."""
        for step in (one for one in steps if one.kind not in ("second", *PLAYS)):
            with self._timed(step):
                step.do()
        self._side_by_side([one for one in steps if one.kind == "second"])
        if self.options.train_only:
            return
        with server(self.folder, self.data, self.options.workers) as url:
            say(f"A server for this: {url} (its data: {self.data})")
            with Client(url) as client:
                self.player = Player(self.study, client, recordings=self.options.recordings)
                for step in (one for one in steps if one.kind in PLAYS):
                    with self._timed(step):
                        step.do()
                self.player.export(self.out / "exports")

    def _side_by_side(self, steps: Sequence[Step]) -> None:
        """Trains what does not wait for each other, some at a time with a share of the cores."""

        def do(step: Step) -> None:
            with self._timed(step, self.options.at_once):
                step.do()

        with ThreadPoolExecutor(self.options.at_once) as pool:
            begun = [pool.submit(do, step) for step in steps]
            try:
                for one in as_completed(begun):
                    one.result()
            except BaseException:
                for one in begun:
                    one.cancel()
                self.folder.stop()
                raise

    @property
    def _threads(self) -> int | None:
        """What one of the trainings that run at once may have; None: all."""
        at_once: int = self.options.at_once
        return max(1, count_cpus() // at_once) if at_once > 1 else None

    @contextmanager
    def _timed(self, step: Step, at_once: int = 1) -> Iterator[None]:
        """Says what begins, and adds up what it takes of the machine, over restarts as well."""
        say(f"{step.kind}: {step.name}")
        began = time.monotonic()
        try:
            yield
        finally:
            with self._timing:
                self._add(step, (time.monotonic() - began) / at_once)

    def _add(self, step: Step, seconds: float) -> None:
        spent, path = make_results.spent(self.out), self.out / make_results.TIMES
        of_kind = spent.setdefault(step.kind, {})
        of_kind[step.name] = round(of_kind.get(step.name, 0.0) + seconds, 1)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(spent, indent=1) + "\n")
        part.replace(path)
