"""What a person sees of an evaluation on a server: a line or a bar, and its rates at the end."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from hide_tasks.contract import Category
from hide_tasks.statistics import Rate
from server.client import Happening
from server.schemas.episodes import EpisodePublic
from server.schemas.evaluations import EvaluationPublic
from server.tables import label, percent

EVERY = 10.0  # s between two plain lines
Watcher = Callable[[Happening], None]


@contextmanager
def following() -> Iterator[Watcher]:
    """Tells standard error what happens: a bar on a terminal, lines elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(console)
        return
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
    with Progress(*columns, console=console) as progress:
        yield _Bar(console, progress)


class _Lines:
    def __init__(self, console: Console):
        self.console, self.told, self.shown = console, -EVERY, -1

    def __call__(self, one: Happening) -> None:
        if one.kind == "progress":
            self.progress(one.data["progress"])
        elif line := _worded(one):
            self.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def progress(self, progress: dict[str, Any]) -> None:
        done = progress["final"] == progress["expected"]
        if self.shown != progress["final"] and (done or monotonic() - self.told > EVERY):
            self.told, self.shown = monotonic(), progress["final"]
            line = f"{self.shown} of {progress['expected']} episodes{_pace(progress)}"
            self.console.print(line, markup=False, highlight=False, soft_wrap=True)


class _Bar(_Lines):
    def __init__(self, console: Console, shown: Progress):
        super().__init__(console)
        self.bar = shown
        self.row = shown.add_task("", total=None, pace="")

    def progress(self, progress: dict[str, Any]) -> None:
        final, total = progress["final"], progress["expected"]
        self.bar.update(self.row, completed=final, total=total, pace=_pace(progress))


def _worded(one: Happening) -> str | None:
    """What is worth a line: not every episode is."""
    if one.kind == "evaluation":
        return f"{one.data['state']}{_because(one.data.get('reason'))}"
    if one.kind == "attempt" and one.data["state"] == "lost":
        return f"{one.data['task']}: an attempt was lost{_because(one.data.get('reason'))}"
    if one.kind == "divergence":
        return f"{one.data['id']}: a second, different result was refused"
    return None


def _because(reason: object) -> str:
    return f": {reason}" if reason else ""


def _pace(progress: dict[str, Any]) -> str:
    if not progress.get("seconds_left"):
        return ""
    return f", {progress['per_minute']:.1f}/min, {progress['seconds_left'] / 60:.0f} min left"


def rates(done: EvaluationPublic, episodes: Sequence[EpisodePublic]) -> Table:
    """Both rates per task and overall."""
    table = Table(
        title=f"{done.policy}@{done.version} on {done.suite}, {done.split}: {done.id}",
        caption="success rates with 95 % Wilson intervals",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for heading in ("", "task", "success", "exact"):
        table.add_column(heading, no_wrap=True)
    table.add_column("n", justify="right")
    for category in Category:
        for task in sorted({one.task for one in episodes if one.category == category}):
            _add(table, category, task, [one for one in episodes if one.task == task])
    table.add_section()
    _add(table, None, "overall", episodes)
    return table


def _add(
    table: Table, category: Category | None, name: str, episodes: Sequence[EpisodePublic]
) -> None:
    number = len(episodes)
    success = percent(Rate(sum(bool(one.success) for one in episodes), number))
    exact = percent(Rate(sum(bool(one.exact) for one in episodes), number))
    table.add_row(label(category), name, success, exact, str(number))
