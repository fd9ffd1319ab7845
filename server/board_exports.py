"""The leaderboard as a file, with the rows, columns and order that were asked for."""

from collections.abc import Iterator
from functools import partial
from typing import Any

from server import latex, latex_table
from server.exports import NOTE, TableFormat, line_of, written
from server.schemas.common import RatePublic
from server.schemas.leaderboard import BeliefPublic, Leaderboard, LeaderboardRow, NormalisedPublic

BOUNDS = ("", "_low", "_high")
FACTS = ("memory", "window", "clock", "privileged", "preset")


def of_leaderboard(
    board: Leaderboard, format: TableFormat, *, table: bool = False
) -> Iterator[bytes]:
    """The leaderboard as a file.

    Args:
        table: as LaTeX, the whole table and not its rows alone.
    """
    return written(board, format, _csv, partial(_latex, table=table))


def _latex(board: Leaderboard, *, table: bool) -> str:
    remarks = (f"{board.suite}, {board.split}, {board.verdict} in percent. {NOTE}",)
    shown = {str(column.category) for column in board.columns}
    kinds = [kind for kind in latex.COLUMNS if kind in shown]
    if table:
        return latex_table.whole(board, remarks, kinds)
    return latex.of_leaderboard(board.rows, board.verdict, remarks, kinds)


def _csv(board: Leaderboard) -> Iterator[bytes]:
    names = [column.task for column in board.columns]
    head = ["rank", "policy", "version", "reference", "evaluation", "ended"]
    for verdict in ("success", "exact"):
        head += [f"{verdict}{part}" for part in ("", "_low", "_high", "_episodes")]
        head += [f"{verdict}_{name}" for name in names]
    yield line_of([*head, *MORE])
    for row in board.rows:
        cells: list[Any] = [row.rank, row.policy, row.version, row.reference, row.evaluation]
        cells.append(row.ended.isoformat())
        for verdict in ("success", "exact"):
            rate = getattr(row.overall, verdict)
            cells += [rate.value, rate.low, rate.high, rate.episodes]
            cells += [getattr(row.tasks[name], verdict).value for name in names]
        yield line_of([*cells, *_more(row)])


MORE = (
    "rank_best",
    "rank_worst",
    *(f"{name}{part}" for name in ("gap", "normalised", "belief") for part in BOUNDS),
    "belief_decisions",
    "owner",
    *FACTS,
)


def _more(row: LeaderboardRow) -> list[Any]:
    cells: list[Any] = [row.rank_best, row.rank_worst]
    for found in (row.gap, row.normalised, row.belief):
        cells += _bounds(found)
    known = [getattr(row.facts, name, None) for name in FACTS]
    return [*cells, row.belief and row.belief.decisions, row.owner, *known]


def _bounds(found: RatePublic | NormalisedPublic | BeliefPublic | None) -> list[float | None]:
    return [found.value, found.low, found.high] if found else [None] * len(BOUNDS)
