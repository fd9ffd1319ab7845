"""Has a server evaluate the study's policies."""

import time
from collections.abc import Callable
from hashlib import sha256 as hashed
from pathlib import Path

from docs import results_measured
from docs.own_processes import Failed
from docs.results_words import percent
from seek_model.study import SPLIT, Run, Study
from server.client import Client, Happening
from server.schemas.evaluations import Progress
from server.states import EvaluationState

EVERY = 60.0  # s between two lines about an evaluation
EXPORTS = {  # what stands beside the tables
    "leaderboard": ("csv", "json", "latex"),
    "ablations": ("csv", "json", "latex"),
}


class Player:
    """A study at a server.

    Args:
        study: says which episodes.
        client: of the server.
        recordings: whether they are kept.
    """

    def __init__(self, study: Study, client: Client, *, recordings: bool):
        self.study, self.client, self.recordings = study, client, recordings

    def play_run(self, run: Run, path: Path) -> None:
        """Evaluates a run's weights, which the server gets unless it has them."""
        sha256 = digest(path)
        there = [
            one.id
            for one in self.client.policies()
            if one.policy == run.policy and getattr(one.spec, "sha256", "") == sha256
        ]
        about = f"{run.preset}, seed {run.seed}, from {run.start}"
        id = there[0] if there else self.client.upload(path, run.policy, about).id
        self.play(run.name, id)

    def play(self, name: str, policy: str) -> None:
        """Evaluates a policy; an evaluation that was asked for before goes on.

        Raises:
            Failed: it did not come to its end.
        """
        wanted = {
            "tasks": list(results_measured.tasks_of(self.study)),
            "episodes": results_measured.episodes_of(self.study),
            "split": SPLIT,
            "recordings": self.recordings,
        }
        key = f"study/{name}/{policy}/{self.recordings}"
        asked = self.client.evaluate(policy, key=key, **wanted)
        if asked.state in (EvaluationState.INCOMPLETE, EvaluationState.CANCELLED):
            self.client.resume(asked.id)
        done = self.client.wait(asked.id, telling(name))
        if done.state != EvaluationState.COMPLETED:
            raise Failed(f"The evaluation of {name} is {done.state}: {done.reason}")
        rate = done.verdicts.success
        say(f"{name}: {rate.successes} of {rate.episodes} episodes, {percent(rate.value)} %")

    def export(self, folder: Path) -> None:
        """Writes the server's own tables."""
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


def digest(path: Path) -> str:
    """A file's SHA-256."""
    return hashed(path.read_bytes()).hexdigest()


def say(line: str) -> None:
    """A line with the time."""
    print(f"{time.strftime('%H:%M:%S')}  {line}", flush=True)
