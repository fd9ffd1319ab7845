"""Batches: evaluations that were asked for together."""

from fastapi import Request
from fastapi.responses import HTMLResponse

from server import batches
from server.access import Router, Scope, needs
from server.deps import Cursor, Reading
from web.templating import page

router = Router(include_in_schema=False)

LISTED = 50


@router.get("/batches")
@needs(Scope.READ)
def list_batches(request: Request, session: Reading, cursor: Cursor = None) -> HTMLResponse:
    """Batches in numbers, latest first."""
    found = batches.listed(session, limit=LISTED, cursor=cursor)
    return page(request, "batches.html", {"found": found, "cursor": cursor})


@router.get("/batches/{batch}")
@needs(Scope.READ)
def show_batch(request: Request, session: Reading, batch: str) -> HTMLResponse:
    """What became of every item."""
    shown = {"batch": batches.get(session, batch), "wanted": batches.row(session, batch).wanted}
    return page(request, "batch.html", shown)
