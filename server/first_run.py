"""What `make run` does: evaluates the built-in policies on all tasks and prints one table.

What is there already is not played again.
"""

import sys
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hide_tasks import ALL_TASKS
from hide_tasks.certificates import certificate
from server.arguments import BadUsage
from server.run import run
from server.tables import Row, by_task, label, percent, summed
from workers.evaluation import LAYOUT, Evaluation
from workers.run_folder import RECORDINGS, Results

FOLDER = Path("runs", "first")
MOST_COLUMNS = 5  # tasks beside each other; more are shown category by category


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


def tables(runs: Mapping[str, Results]) -> list[Table]:
    """Policies below, tasks beside each other, both verdicts with intervals, and ceilings."""
    rows = {name: by_task(results) for name, results in runs.items()}
    columns = next(iter(rows.values()))
    groups = [columns]
    if len(columns) > MOST_COLUMNS:
        groups = [list(group) for _, group in groupby(columns, key=lambda row: row.category)]
    return [_table(rows, [row.name for row in group]) for group in groups]


def _table(rows: Mapping[str, Sequence[Row]], names: Sequence[str]) -> Table:
    table = Table(caption="success rates with 95 % Wilson intervals", show_lines=True)
    table.add_column("policy")
    table.add_column("verdict")
    for row in (shown := _only(next(iter(rows.values())), names)):
        table.add_column(label(row.category).append(f"\n{row.name}"), no_wrap=True)
    table.add_column("together", no_wrap=True)
    for policy, cells in rows.items():
        shown = _only(cells, names)
        table.add_row(policy, "success\nexact", *map(_cell, [*shown, summed("", shown)]))
    table.add_row("best without\nmemory", "success\nexact", *map(_ceiling, names))
    return table


def _only(rows: Sequence[Row], names: Sequence[str]) -> list[Row]:
    return [row for row in rows if row.name in names]


def _cell(row: Row) -> str:
    return f"{percent(row.success)}\n{percent(row.exact)}  n={row.coverage}"


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
    try:
        runs = evaluate_all(FOLDER)
    except BadUsage as error:
        sys.exit(f"make run: {error}")
    except KeyboardInterrupt:
        sys.exit("make run: stopped; `make run` goes on from here.")
    console = Console(soft_wrap=not sys.stdout.isatty())
    for table in tables(runs):
        console.print(table)
    console.print(where_to_look(runs, FOLDER), soft_wrap=True, markup=False, highlight=False)
    if not all(results.complete for results in runs.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
