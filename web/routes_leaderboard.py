"""The leaderboard: policies against tasks."""

from collections.abc import Sequence
from threading import Lock
from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup

from hide_tasks.contract import Category, Split
from server import evaluations, leaderboard
from server.access import Gate, Router, Scope, needs
from server.deps import Reading
from server.files import File
from server.schemas import Leaderboard, LeaderboardColumn, Verdict
from web.templating import STATIC, page, part

router = Router(include_in_schema=False)

MOST_DRAWN = 8  # of 250 policies, 3 MB each
SHOWN_SPLITS: tuple[Split, ...] = ("test", "val")


@router.get("/")
@needs(Scope.READ)
def show_leaderboard(
    request: Request,
    session: Reading,
    split: Annotated[Split, Query()] = "test",
    verdict: Annotated[Verdict, Query()] = "success",
) -> HTMLResponse:
    """Complete evaluations of the whole suite, best first."""
    board = leaderboard.leaderboard(session, split=split, verdict=verdict)
    shown = {
        "board": board,
        "ranked": any(not row.reference for row in board.rows),
        "drawn": kept_drawn(board),
        "splits": SHOWN_SPLITS,
        "under_way": evaluations.listed(session, limit=5).items if not board.rows else [],
    }
    return page(request, "leaderboard.html", shown)


def kept_drawn(board: Leaderboard) -> Markup:
    """As `drawn`, once for a leaderboard that the server keeps: 250 policies take 0.5 s."""
    with _drawing:
        known = _drawn.get(id(board))
        if known is None:
            if len(_drawn) >= MOST_DRAWN:
                _drawn.clear()
            known = _drawn[id(board)] = (board, drawn(board))
    return known[1]


_drawn: dict[int, tuple[Leaderboard, Markup]] = {}  # with what an id is of, so that it stays
_drawing = Lock()


def drawn(board: Leaderboard) -> Markup:
    """A leaderboard's table."""
    return part("board.html", _board(board))


def _board(board: Leaderboard) -> dict[str, Any]:
    return {
        "board": board,
        "other": "exact" if board.verdict == "success" else "success",
        "groups": groups(board.columns),
        "ranked": [row for row in board.rows if not row.reference],
        "references": [row for row in board.rows if row.reference],
    }


def groups(
    columns: Sequence[LeaderboardColumn],
) -> list[tuple[Category, list[LeaderboardColumn]]]:
    """The columns by category, in the paper's order."""
    found = ((kind, [column for column in columns if column.category is kind]) for kind in Category)
    return [(kind, tasks) for kind, tasks in found if tasks]


@router.get("/favicon.ico")
@needs(Gate.PUBLIC)
def show_icon() -> Response:
    """The icon, for browsers that look for it where it always was."""
    return File(STATIC / "favicon.svg", media_type="image/svg+xml")
