"""What `make run` does: evaluates the built-in policies on all tasks and prints one table.

What is there already is not played again; other sources of the tasks have a folder of their own.
"""

import hashlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from hide_tasks import ALL_TASKS, load
from hide_tasks.certificates import certificate
from hide_tasks.sources import sources_hash
from server.arguments import BadUsage
from server.run import run
from server.tables import Row, by_task, color, percent, screen, summed
from workers.evaluation import LAYOUT, Evaluation
from workers.results import Results
from workers.run_folder import RECORDINGS

RUNS = Path("runs")
LABELS, COLUMN = 24, 18  # characters of a table's width: its first columns, each task


def folder_of(tasks: Sequence[str]) -> Path:
    """Where the runs of these tasks, as they are now, stand."""
    together = "".join(sources_hash(task) for task in tasks)
    return RUNS / f"first-{hashlib.sha256(together.encode()).hexdigest()[:8]}"


def policies(folder: Path) -> dict[str, str]:
    """POLICY by the name of its folder; a replay needs the expert's run before it."""
    return {
        "expert": "expert",
        "replay": f"replay:{folder / 'expert'}",
        "amnesiac": "amnesiac",
        "random": "random",
        "noop": "noop",
    }


def evaluate_all(
    folder: Path, tasks: Sequence[str] = ALL_TASKS, episodes: int | None = None
) -> dict[str, Results]:
    """The results of every built-in policy, by name; resumes what is in the folder.

    Raises:
        BadUsage: the folder holds something else.
        KeyboardInterrupt: stopped; another call goes on.
    """
    return {
        name: run(Evaluation(policy, tuple(tasks), episodes=episodes), folder / name)
        for name, policy in policies(folder).items()
    }


def tables(runs: Mapping[str, Results], width: int) -> list[Table]:
    """Policies below, tasks beside each other, both verdicts with intervals, and ceilings.

    As many tasks stand in one table as the width, in characters, has room for.
    """
    rows = {name: by_task(results) for name, results in runs.items()}
    tasks = [row.name for row in next(iter(rows.values()))]
    room = max(1, (width - LABELS) // COLUMN - 1)  # one column is for all of them
    return [_table(rows, tasks[start : start + room]) for start in range(0, len(tasks), room)]


def _table(rows: Mapping[str, Sequence[Row]], names: Sequence[str]) -> Table:
    table = Table(
        caption="success rates with 95 % Wilson intervals",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 1, 0),
    )
    for heading in (Text("policy"), Text("verdict"), *map(_heading, names), Text("overall")):
        table.add_column(heading, overflow="fold")
    for policy, cells in rows.items():
        overall = summed("overall", cells)
        shown = [row for row in cells if row.name in names]
        label = f"{policy}\nn={overall.coverage}"
        table.add_row(label, "success\nexact", *map(_cell, [*shown, overall]))
    table.add_row("best without\nmemory", "success\nexact", *map(_ceiling, names))
    return table


def _heading(task: str) -> Text:
    return Text(task, style=f"bold {color(load(task).category)}")


def _cell(row: Row) -> str:
    return f"{percent(row.success)}\n{percent(row.exact)}"


def _ceiling(task: str) -> str:
    proof = certificate(task)
    if proof is None:
        return "not certified"
    return f"{100 * proof.ceiling_success:3.0f} %\n{100 * proof.ceiling_exact:3.0f} %"


def where_to_look(runs: Mapping[str, Results], folder: Path) -> str:
    """How to see an episode: one that went wrong for want of memory, if there is one."""
    name = "amnesiac" if any(one.failure for one in runs["amnesiac"].episodes) else "expert"
    recorded = [one for one in runs[name].episodes if one.recording]
    if not recorded:
        return f"No recordings in {folder}."
    shown = next((one for one in recorded if one.failure), recorded[0])
    viewer = Path(sys.executable).with_name("rerun")
    if viewer.is_relative_to(Path.cwd()):
        viewer = viewer.relative_to(Path.cwd())
    where = folder / name
    return (
        f"Recordings: {folder}/*/{RECORDINGS}/*.rrd. To watch one "
        f"({name}, {shown.task}: {shown.failure or 'exact'}):\n"
        f"  {viewer} {where / RECORDINGS / LAYOUT} {where / str(shown.recording)}"
    )


def main() -> None:
    """Evaluate, print, and say where to look."""
    folder = folder_of(ALL_TASKS)
    try:
        runs = evaluate_all(folder)
    except BadUsage as error:
        sys.exit(f"make run: {error}")
    except KeyboardInterrupt:
        sys.exit("make run: stopped; `make run` goes on from here.")
    for table in tables(runs, screen().width):
        screen().print(table)
    screen().print(where_to_look(runs, folder), soft_wrap=True, markup=False, highlight=False)
    if not all(results.complete for results in runs.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
