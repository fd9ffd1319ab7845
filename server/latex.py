"""Rows of the paper's main table (its `tab:main_results`): one policy, percent, its columns."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean

from server.schemas.common import Verdict, Verdicts
from server.schemas.leaderboard import LeaderboardRow

COLUMNS = {  # in the paper's order
    "RC": (
        "push_button_times",
        "stack_blocks",
        "change_channel_times",
        "stack_cups_new",
        "stack_blocks_new",
    ),
    "HSR": (
        "weighing_on_off",
        "pour_put_back",
        "wipe_desk_rubbish",
        "light_bulb_in_out",
        "reopen_drawer",
    ),
    "EPT": (
        "search_drawer",
        "search_boxes",
        "search_cup_from_cabinet",
        "lift_and_check",
        "swap_square_pegs",
    ),
}
ESCAPED = str.maketrans(
    {char: f"\\{char}" for char in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
)
NONE = "--"  # not measured
MARKS = ("\\textbf{%s}", "\\underline{%s}")  # best, second best


def escaped(text: str) -> str:
    """Text as LaTeX prints it, on one line."""
    return " ".join(text.split()).translate(ESCAPED)


def cells(
    tasks: Mapping[str, Verdicts], verdict: Verdict, kinds: Iterable[str] = tuple(COLUMNS)
) -> list[str]:
    """The numbers of a row: overall average, then per category its tasks and their average.

    An average over tasks of which one is missing is not given.
    """
    known = {
        kind: [_percent(tasks.get(name), verdict) for name in names]
        for kind, names in COLUMNS.items()
    }
    columns = [_average([value for values in known.values() for value in values])]
    for kind in kinds:
        columns += [*(_number(value, 0) for value in known[kind]), _average(known[kind])]
    return columns


def row(name: str, numbers: Sequence[str]) -> str:
    """A line of the table."""
    return f"{escaped(name)} & {' & '.join(numbers)} \\\\\n"


def of_evaluation(
    name: str, tasks: Mapping[str, Verdicts], verdict: Verdict, remarks: Iterable[str]
) -> str:
    """The row of one evaluation, below comments that say what it is."""
    return comments(remarks) + row(name, cells(tasks, verdict))


def of_leaderboard(
    rows: Sequence[LeaderboardRow],
    verdict: Verdict,
    remarks: Iterable[str],
    kinds: Iterable[str] = tuple(COLUMNS),
) -> str:
    """All rows, below comments that say what they are."""
    return comments(remarks) + "".join(marked(rows, verdict, tuple(kinds)))


def marked(rows: Sequence[LeaderboardRow], verdict: Verdict, kinds: Sequence[str]) -> list[str]:
    """All rows; the best of each column is bold, the second best underlined, ties as well.

    Reference policies know the hidden state or play at random: they are given and not compared.
    """
    numbers = [cells(one.tasks, verdict, kinds) for one in rows]
    ranked = [line for one, line in zip(rows, numbers, strict=True) if not one.reference]
    best = [_best(column) for column in zip(*ranked, strict=True)]
    lines = []
    for one, line in zip(rows, numbers, strict=True):
        if not one.reference:
            line = [_marked(cell, two) for cell, two in zip(line, best, strict=True)]
        lines.append(row(f"{one.policy}@{one.version}", line))
    return lines


def comments(remarks: Iterable[str]) -> str:
    return "".join(f"% {' '.join(one.split())}\n" for one in remarks)


def _percent(found: Verdicts | None, verdict: Verdict) -> float | None:
    value = getattr(found, verdict).value if found else None
    return None if value is None else 100.0 * value


def _average(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return _number(fmean(known) if len(known) == len(values) else None, 1)


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _best(column: Iterable[str]) -> list[str]:
    """The best and the second best number of a column, as they are printed."""
    known = {cell for cell in column if cell != NONE}
    return sorted(known, key=float, reverse=True)[: len(MARKS)]


def _marked(cell: str, best: Sequence[str]) -> str:
    return MARKS[best.index(cell)] % cell if cell in best and float(cell) > 0 else cell
