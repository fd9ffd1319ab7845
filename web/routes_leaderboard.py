"""The leaderboard: policies against tasks."""

from typing import Annotated

from fastapi import Query, Request
from fastapi.responses import HTMLResponse, Response

from hide_tasks.contract import Split
from server import evaluations, standings
from server.access import Gate, Router, Scope, needs
from server.deps import Reading
from server.files import File
from server.first_run import ORDER
from server.suites import BOARDS
from web.board import VIEWS, PageQuery, Shown, fields, tabs
from web.templating import STATIC, page

router = Router(include_in_schema=False)

SHOWN_SPLITS: tuple[Split, ...] = ("test", "test100", "val")


@router.get("/")
@needs(Scope.READ)
def show_leaderboard(
    request: Request, session: Reading, wanted: Annotated[PageQuery, Query()]
) -> HTMLResponse:
    """Complete evaluations of the whole suite, best first or as the address says."""
    whole = standings.whole(session, wanted)
    key = (whole.suite, whole.split, tuple(row.evaluation for row in whole.rows))
    found = Shown(whole, wanted, key)
    shown = {
        "page": found,
        "board": whole,
        "ranked": any(not row.reference for row in whole.rows),
        "drawn": found.drawn() if found.board.rows else "",
        "splits": SHOWN_SPLITS,
        "views": VIEWS,
        "tabs": tabs(wanted, BOARDS),
        "kept": False,
        "snapshot_action": f"/snapshots{fields(wanted)}",
        "under_way": evaluations.listed(session, limit=len(ORDER)).items if not whole.rows else [],
    }
    return page(request, "leaderboard.html", shown)


@router.get("/favicon.ico")
@needs(Gate.PUBLIC)
def show_icon() -> Response:
    """The icon, for browsers that look for it where it always was."""
    return File(STATIC / "favicon.svg", media_type="image/svg+xml")
