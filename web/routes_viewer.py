"""The viewer's files: fetched once by a browser, then kept for as long as their version lives."""

import asyncio
import gzip
from collections.abc import Iterator
from pathlib import Path

from fastapi import Request
from fastapi.responses import Response, StreamingResponse

from server.access import Router, Scope, needs
from server.files import File
from server.problems import Problem, not_found
from web.viewer_assets import LAYOUTS, SCRIPT, WASM, ViewerAssets, ViewerFiles, ViewerMissing

router = Router(include_in_schema=False)

FOREVER = {"Cache-Control": "public, max-age=31536000, immutable"}
PIECE = 1 << 18  # bytes


async def viewer_files(request: Request) -> ViewerFiles:
    """The files, waited for if they are still being made.

    Raises:
        Problem: 503, they cannot be made.
    """
    assets: ViewerAssets = request.app.state.viewer
    try:
        return await asyncio.shield(asyncio.wrap_future(assets.begin()))
    except ViewerMissing as error:
        raise Problem(503, "viewer_missing", str(error)) from error


@router.get("/viewer/{version}/{name}")
@needs(Scope.READ)
async def viewer_file(request: Request, version: str, name: str) -> Response:
    """One file of the viewer."""
    assets: ViewerAssets = request.app.state.viewer
    if version != assets.version or name not in (SCRIPT, WASM, *LAYOUTS):
        raise not_found("file of the viewer", f"{version}/{name}")
    files = await viewer_files(request)
    if name == SCRIPT:
        return File(files.script, media_type="text/javascript", headers=FOREVER)
    if name in LAYOUTS:
        return File(files.layouts[name], media_type="application/octet-stream", headers=FOREVER)
    return _wasm(files.wasm, request.headers.get("accept-encoding", ""))


def _wasm(path: Path, accepted: str) -> Response:
    headers = {**FOREVER, "Vary": "Accept-Encoding"}
    if _takes_gzip(accepted):
        headers["Content-Encoding"] = "gzip"
        return File(path, media_type="application/wasm", headers=headers)
    return StreamingResponse(_unpacked(path), media_type="application/wasm", headers=headers)


def _takes_gzip(accepted: str) -> bool:
    offers = (offer.replace(" ", "").lower() for offer in accepted.split(","))
    return any(offer.partition(";")[0] in ("gzip", "*") and not _refused(offer) for offer in offers)


def _refused(offer: str) -> bool:
    quality = offer.partition(";q=")[2]
    return bool(quality) and quality.strip("0.") == ""


def _unpacked(path: Path) -> Iterator[bytes]:
    with gzip.open(path) as file:
        while piece := file.read(PIECE):
            yield piece
