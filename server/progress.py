"""What a person sees on standard error while an evaluation runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from hide_tasks.contract import EpisodeResult, EpisodeSpec
from workers.evaluation import POLICY_LOG, WORKERS_LOG, Watcher
from workers.run_folder import RunFolder
from workers.sandbox.choice import Sandbox

EVERY = 10.0  # s between two plain lines
CLOSED = "without network, your files or further processes; --sandbox none opens it"
WORDS = {
    Sandbox.BUBBLEWRAP: f"The policy plays in a sandbox (bubblewrap), {CLOSED}.",
    Sandbox.LANDLOCK: f"The policy plays in a sandbox (Landlock), {CLOSED}.",
    Sandbox.NONE: "The policy plays without a sandbox: it can do what you can.",
}


class Reporter(Watcher):
    """Counts, and words what is counted."""

    def __init__(self, console: Console):
        self.console = console
        self.done = self.total = self.successes = 0
        self.began = monotonic()
        self.warned = False

    def closed(self, sandbox: Sandbox) -> None:
        self.say(WORDS[sandbox])

    def begun(self, folder: RunFolder, left: int) -> None:
        self.folder, self.total = folder.path, left
        self.began = monotonic()
        there = len(folder.results.episodes)
        episodes = f"{left} episode{'s' * (left != 1)} to play"
        self.say(f"{folder.path}: {episodes}" + f", {there} there" * bool(there))

    def finished(self, result: EpisodeResult) -> None:
        self.done += 1
        self.successes += result.success
        erred = str(result.failure).startswith("policy")
        if erred and not self.warned:  # whoever wrote the policy wants to know at once
            self.warned = True
            self.say(f"{result.task} {result.index}: {result.failure}: {result.detail}")

    def lost(self, episode: EpisodeSpec, reason: str, final: bool) -> None:
        end = "given up" if final else "tried again"
        self.say(f"{episode.name}: {reason}; {end}.")
        if final:
            self.say(f"See {WORKERS_LOG} and {POLICY_LOG} in {self.folder}.")

    def say(self, line: str) -> None:
        """One line on standard error."""
        self.console.print(line, markup=False, highlight=False, soft_wrap=True)

    @property
    def pace(self) -> str:
        """Episodes per minute, time left and success so far."""
        rate = self.done / max(monotonic() - self.began, 1e-9)
        left = (self.total - self.done) / rate if rate else 0.0
        success = 100 * self.successes / max(self.done, 1)
        return f"{60 * rate:.1f}/min, {_duration(left)} left, {success:.0f} % success"


class Lines(Reporter):
    """For a log: a plain line now and then."""

    def __init__(self, console: Console):
        super().__init__(console)
        self.told = monotonic()

    def finished(self, result: EpisodeResult) -> None:
        super().finished(result)
        if self.done == self.total or monotonic() - self.told > EVERY:
            self.told = monotonic()
            self.say(f"{self.done} of {self.total} episodes, {self.pace}")


class Bar(Reporter):
    """For a terminal: a bar that stays in place."""

    def __init__(self, console: Console, progress: Progress):
        super().__init__(console)
        self.progress = progress
        self.row = progress.add_task("", total=None, pace="", visible=False)

    def begun(self, folder: RunFolder, left: int) -> None:
        super().begun(folder, left)
        self.progress.update(self.row, total=left, visible=left > 0)

    def finished(self, result: EpisodeResult) -> None:
        super().finished(result)
        self.progress.update(self.row, completed=self.done, pace=self.pace)


@contextmanager
def reporting() -> Iterator[Reporter]:
    """A reporter that suits standard error: a bar on a terminal, lines elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(console)
        return
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
    with Progress(*columns, console=console) as progress:
        yield Bar(console, progress)


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
