"""The study's steps in their folder: what is there, what is left, and how it is done."""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from docs import make_results, results_measured
from docs.own_processes import ROOT, Failed, Folder, server
from docs.results_measured import REFERENCES
from docs.results_words import percent
from seek_model.checkpoint_header import BadCheckpoint, read_header
from seek_model.study import SPLIT, Run, Study, is_of, recipe
from server.client import Client, Happening
from server.schemas.evaluations import Progress
from server.states import EvaluationState

CHECKPOINT, CHECKPOINT_FIRST = "checkpoint.safetensors", "checkpoint-first.safetensors"
EVERY = 60.0  # s between two lines about an evaluation
EXPORTS = {  # what stands beside the tables
    "leaderboard": ("csv", "json", "latex"),
    "ablations": ("csv", "json", "latex"),
}


class Step(NamedTuple):
    """Something that is left to do."""

    kind: str  # whose seconds are known
    name: str
    do: Callable[[], None]


class Reproduction:
    """A study in its folder."""

    def __init__(self, study: Study, options: argparse.Namespace):
        self.study, self.options = study, options
        self.out: Path = options.out
        self.demos: Path = options.demos or self.out / "demos"
        self.data: Path = self.out / "data"
        chosen = options.only.split(",") if options.only else [run.name for run in study.runs]
        self.runs = [study.run(name) for name in chosen]
        self.references = () if options.only else REFERENCES

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
            config = read_header(path).config
        except (BadCheckpoint, OSError) as error:
            raise Failed(f"{path} cannot be used: {error}") from None
        if run.start and not is_of(run, config):
            raise Failed(
                f"{path} is of {config.name} with seed {config.train.seed}; {run.name} is "
                f"{run.preset} with seed {run.seed}, started from {run.start}."
            )
        return True

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
            Step("second" if run.start else "first", run.name, self._training(run))
            for run in training
        ]
        return steps if self.options.train_only else steps + self._evaluations()

    def _demonstrations(self) -> Iterator[Step]:
        tasks = ("--tasks", ",".join(self.study.tasks)) if self.study.tasks else ()
        for split, episodes in self.study.demonstrations.items():
            count = ("--episodes", episodes) if episodes else ()
            arguments = ("demos", "--out", self.demos, "--split", split, *count, *tasks)

            def record(arguments: tuple[str | Path | int, ...] = arguments) -> None:
                self.folder.hide(*arguments)

            yield Step(f"demonstrations of {split}", split, record)

    def _training(self, run: Run) -> Callable[[], None]:
        def train() -> None:
            arguments: list[str | Path | int] = ["--data", self.demos, "--seed", run.seed]
            arguments += ["--out", self.out / "runs" / run.name]
            if run.start:
                start = self.checkpoint(self.study.run(run.start))
                arguments += ["--start", os.path.relpath(start, ROOT)]
            self.folder.hide("train", self._recipe(run), *arguments)

        return train

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
        steps = []
        for name in self.references:
            if name not in there:
                steps.append(Step("reference", name, lambda name=name: self._play(name, name)))
        for run in self.runs:
            if run.start and not self._counts(run, there):
                steps.append(Step("evaluation", run.name, lambda run=run: self._play_run(run)))
        return steps

    def _counts(self, run: Run, there: dict[str, results_measured.Record]) -> bool:
        """True if what was measured is of the weights that are there."""
        path = self.checkpoint(run)
        found = there.get(run.name)
        return bool(found and path.exists() and found["sha256"] == _digest(path))

    # --- what is done ---

    def do(self, steps: list[Step]) -> None:
        """All of it; a server of its own runs for the evaluations, and to export."""
        for step in (one for one in steps if one.kind not in ("reference", "evaluation")):
            with self._timed(step):
                step.do()
        if self.options.train_only:
            return
        with server(self.folder, self.data, self.options.workers) as url:
            say(f"A server for this: {url} (its data: {self.data})")
            with Client(url) as self.client:
                for step in (one for one in steps if one.kind in ("reference", "evaluation")):
                    with self._timed(step):
                        step.do()
                self._export()

    @contextmanager
    def _timed(self, step: Step) -> Iterator[None]:
        """Says what begins, and adds up what it takes, over restarts as well."""
        say(f"{step.kind}: {step.name}")
        began = time.monotonic()
        try:
            yield
        finally:
            spent, path = make_results.spent(self.out), self.out / make_results.TIMES
            of_kind = spent.setdefault(step.kind, {})
            of_kind[step.name] = round(of_kind.get(step.name, 0.0) + time.monotonic() - began, 1)
            part = path.with_suffix(".part")
            part.write_text(json.dumps(spent, indent=1) + "\n")
            part.replace(path)

    def _play_run(self, run: Run) -> None:
        path = self.checkpoint(run)
        digest = _digest(path)
        there = [
            one.id
            for one in self.client.policies()
            if one.policy == run.policy and getattr(one.spec, "sha256", "") == digest
        ]
        about = f"{run.preset}, seed {run.seed}, from {run.start}"
        id = there[0] if there else self.client.upload(path, run.policy, about).id
        self._play(run.name, id)

    def _play(self, name: str, policy: str) -> None:
        """Evaluates a policy; an evaluation that was asked for before goes on.

        Raises:
            Failed: it did not come to its end.
        """
        wanted = {
            "tasks": list(results_measured.tasks_of(self.study)),
            "episodes": results_measured.episodes_of(self.study),
            "split": SPLIT,
            "recordings": self.options.recordings,
        }
        asked = self.client.evaluate(policy, key=f"study/{name}/{policy}", **wanted)
        if asked.state == EvaluationState.INCOMPLETE:
            self.client.resume(asked.id)
        done = self.client.wait(asked.id, telling(name))
        if done.state != EvaluationState.COMPLETED:
            raise Failed(f"The evaluation of {name} is {done.state}: {done.reason}")
        rate = done.verdicts.success
        say(f"{name}: {rate.successes} of {rate.episodes} episodes, {percent(rate.value)} %")

    def _export(self) -> None:
        folder = self.out / "exports"
        folder.mkdir(exist_ok=True)
        for name, formats in EXPORTS.items():
            for form in formats:
                suffix = "tex" if form == "latex" else form
                file = folder / f"{name}.{suffix}"
                self.client.save(f"/api/v1/{name}/export", file, format=form)


def telling(name: str) -> Callable[[Happening], None]:
    """Says now and then how far an evaluation is."""
    last = time.monotonic()

    def tell(one: Happening) -> None:
        nonlocal last
        if one.kind == "progress" and time.monotonic() - last > EVERY:
            last = time.monotonic()
            stands = Progress.model_validate(one.data["progress"])
            say(f"{name}: {stands.final} of {stands.expected} episodes")

    return tell


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def say(line: str) -> None:
    """A line with the time."""
    print(f"{time.strftime('%H:%M:%S')}  {line}", flush=True)
