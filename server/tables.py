"""Tables for a terminal: the catalogue of tasks, and success rates with their intervals."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hide_tasks import load
from hide_tasks.catalogue import suite_of
from hide_tasks.certificates import certificate
from hide_tasks.contract import Category, EpisodeResult
from hide_tasks.statistics import Rate
from workers.results import Results

PAGE = 160  # columns of a table that is not for a screen
COLORS = {"RC": "#D99A5E", "HSR": "#588C78", "EPT": "#8D75A5"}  # the paper's


@dataclass(frozen=True)
class Row:
    """Some episodes of one run, under one heading."""

    name: str
    category: Category | None
    episodes: Sequence[EpisodeResult]
    planned: int

    @property
    def success(self) -> Rate:
        """How often the task's checks held."""
        return Rate(sum(episode.success for episode in self.episodes), len(self.episodes))

    @property
    def exact(self) -> Rate:
        """How often nothing was wrong besides."""
        return Rate(sum(episode.exact for episode in self.episodes), len(self.episodes))

    @property
    def coverage(self) -> str:
        """The number of episodes, and how many were asked for if some are missing."""
        done = len(self.episodes)
        return str(done) if done == self.planned else f"{done} of {self.planned}"

    @property
    def common_failure(self) -> str:
        """The most frequent failure and its number; the first by name if two are alike."""
        failures = Counter(episode.failure for episode in self.episodes if episode.failure)
        if not failures:
            return ""
        name, count = min(failures.items(), key=lambda item: (-item[1], item[0]))
        return f"{name} {count}"


def by_task(results: Results) -> list[Row]:
    """One row per task, category by category."""
    rows = [
        Row(
            name=task,
            category=load(task).category,
            episodes=[episode for episode in results.episodes if episode.task == task],
            planned=results.planned[task],
        )
        for task in results.tasks
    ]
    return sorted(rows, key=_rank)


def by_category(rows: Iterable[Row]) -> list[Row]:
    """One row per category, over all its episodes."""
    groups = groupby(sorted(rows, key=_rank), key=lambda row: row.category)
    return [summed(str(category), list(group), category) for category, group in groups]


def summed(name: str, rows: Sequence[Row], category: Category | None = None) -> Row:
    """One row over all episodes of some."""
    episodes = [episode for row in rows for episode in row.episodes]
    return Row(name, category, episodes, sum(row.planned for row in rows))


def _rank(row: Row) -> int:
    return list(Category).index(row.category) if row.category else len(Category)


def percent(rate: Rate) -> str:
    """A success rate with its interval, e.g. '96 % [80, 99]'; a dash without episodes."""
    if not rate.episodes:
        return "–"
    low, high = rate.interval
    # Outwards: a rounded interval must not promise more than the exact one.
    bounds = f"[{math.floor(100 * low)}, {math.ceil(100 * high)}]"
    return f"{round(100 * rate.value):3d} % {bounds:>9}"


def results_table(results: Results) -> Table:
    """Success, exact, number and most frequent failure per task, category and overall."""
    title = f"{results.policy} on {results.suite} {results.version}, {results.split}"
    caption = "success rates with 95 % Wilson intervals"
    table = Table(
        title=title,
        caption=caption,
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for heading in ("", "task", "success", "exact"):
        table.add_column(heading, no_wrap=True)
    table.add_column("n", justify="right")
    table.add_column("frequent failure", overflow="fold")
    for row in (rows := by_task(results)):
        _add(table, row, row.name)
    table.add_section()
    for row in by_category(rows):
        _add(table, row, "together")
    table.add_section()
    _add(table, summed("overall", rows), "overall")
    return table


def _add(table: Table, row: Row, name: str) -> None:
    cells = [percent(row.success), percent(row.exact), row.coverage, row.common_failure]
    table.add_row(label(row.category), name, *cells)


def label(category: Category | None) -> Text:
    """A category's abbreviation in its colour."""
    return Text(category or "", style=f"bold {color(category)}")


def color(category: Category | None) -> str:
    """A category's colour, as rich understands it."""
    return COLORS[category] if category else "default"


def screen() -> Console:
    """Standard output; a table that is not for a screen has room."""
    console = Console()
    return console if console.is_terminal else Console(width=PAGE)


# --- the catalogue ---


def catalogue(names: Iterable[str]) -> list[dict[str, Any]]:
    """What `hide tasks --json` lists: plain values, one dictionary a task."""
    return [_entry(name) for name in names]


def _entry(name: str) -> dict[str, Any]:
    task, proof = load(name), certificate(name)
    return {
        "name": name,
        "suite": suite_of(name),
        "category": str(task.category),
        "instruction": task.instructions[0],
        "paraphrases": list(task.instructions[1:]),
        "variations": len(task.variations),
        "axes": {axis: list(values) for axis, values in task.axes().items()},
        "hidden_axes": sorted(task.hidden_axes()),
        "keyframes": sorted(task.keyframes),
        "budget": task.budget(),
        "cameras": list(task.cameras),
        "hidden_state": task.remembers,
        "failures": {str(failure): how for failure, how in task.failures.items()},
        "certificate": proof and proof._asdict(),
    }


def catalogue_table(entries: Sequence[Mapping[str, Any]]) -> Table:
    """The catalogue for a reader."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 1, 0))
    columns: dict[str, Callable[[Mapping[str, Any]], Text | str]] = {
        "": lambda entry: label(Category(entry["category"])),
        "task": lambda entry: Text(f"{entry['name']}\n“{entry['instruction']}”"),
        "variations": lambda entry: str(entry["variations"]),
        "keyframes": lambda entry: _span(entry["keyframes"]),
        "hidden state": lambda entry: entry["hidden_state"],
        "certificate": lambda entry: _verdict(entry["certificate"]),
    }
    for heading in columns:
        table.add_column(heading, overflow="fold")
    for entry in sorted(entries, key=lambda entry: list(Category).index(entry["category"])):
        table.add_row(*(cell(entry) for cell in columns.values()))
    return table


def _span(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low}–{high}"


def _verdict(proof: Mapping[str, Any] | None) -> str:
    if proof is None:
        return "not certified"
    ceiling = round(100 * proof["ceiling_exact"])
    return f"{proof['verdict']}: without memory at most {ceiling} % exact"
