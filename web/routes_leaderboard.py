"""The leaderboard: policies against tasks."""

from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import HTMLResponse, Response
from starlette.responses import FileResponse

from hide_tasks.contract import Category, Split
from server import evaluations, leaderboard
from server.access import Gate, Router, Scope, needs
from server.deps import Reading
from server.schemas import Leaderboard, LeaderboardColumn, Verdict
from web.templating import STATIC, page

router = Router(include_in_schema=False)

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
        **board_of(board),
        "splits": SHOWN_SPLITS,
        "under_way": evaluations.listed(session, limit=5).items if not board.rows else [],
    }
    return page(request, "leaderboard.html", shown)


def board_of(board: Leaderboard) -> dict[str, Any]:
    """What board.html wants."""
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
    return FileResponse(STATIC / "favicon.svg", media_type="image/svg+xml")
