"""Snapshots: leaderboards as they stood."""

from typing import Annotated

from fastapi import Form, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from hide_tasks.contract import Split
from hide_tasks.suite import SUITE
from server import snapshots
from server.access import Router, Scope, needs
from server.deps import Cursor, Reading, TheHub, ThePrincipal
from server.routes.snapshots import take_snapshot
from server.schemas.snapshots import SnapshotContent, SnapshotCreate
from server.suites import BOARDS, BoardName
from web.board import VIEWS, PageQuery, Shown, fields
from web.routes_leaderboard import SHOWN_SPLITS
from web.templating import page

router = Router(include_in_schema=False)

LISTED = 50
MOST_NOTE = 2000  # characters
# The number of a snapshot says its suite and split; its address need not.
NUMBERED = {"suite": SUITE, "split": "test"}


@router.get("/snapshots")
@needs(Scope.READ)
def list_snapshots(request: Request, session: Reading, cursor: Cursor = None) -> HTMLResponse:
    """Snapshots, latest first, and the form that takes one."""
    shown = {
        "found": snapshots.listed(session, limit=LISTED, cursor=cursor),
        "cursor": cursor,
        "suites": BOARDS,
        "splits": SHOWN_SPLITS,
        "most_note": MOST_NOTE,
    }
    return page(request, "snapshots.html", shown)


@router.post("/snapshots")
@needs(Scope.MAINTAIN)
def keep_leaderboard(
    hub: TheHub,
    principal: ThePrincipal,
    wanted: Annotated[PageQuery, Query()],
    suite: Annotated[BoardName, Form()] = SUITE,
    split: Annotated[Split, Form()] = "test",
    note: Annotated[str, Form(max_length=MOST_NOTE)] = "",
) -> Response:
    """Keeps the leaderboard as it stands, and shows what was kept in the view it was taken from."""
    create = SnapshotCreate(suite=suite, split=split, note=note)
    taken = take_snapshot(create, hub, principal, Response())
    shown = fields(wanted.model_copy(update=NUMBERED))
    return RedirectResponse(f"/snapshots/{taken.number}{shown}", 303)


@router.get("/snapshots/{snapshot}")
@needs(Scope.READ)
def show_snapshot(
    request: Request,
    session: Reading,
    snapshot: str,
    wanted: Annotated[PageQuery, Query()],
) -> HTMLResponse:
    """A leaderboard as it was kept, and what its rows rest on."""
    row = snapshots.find(session, snapshot)
    content = SnapshotContent.model_validate_json(row.content)
    whole = content.leaderboards[wanted.verdict]
    wanted = wanted.model_copy(update=NUMBERED)
    found = Shown(whole, wanted, row.sha256, f"/snapshots/{row.number}")
    shown = {
        "page": found,
        "views": VIEWS,
        "kept": True,
        "snapshot": snapshots.public(row),
        "content": content,
        "rests_on": {one.evaluation: one for one in content.evaluations},
        "board": whole,
        "drawn": found.drawn() if found.board.rows else "",
    }
    return page(request, "snapshot.html", shown)
