"""Evaluations and the leaderboard as files."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Annotated, Any

from fastapi import Query
from fastapi.responses import StreamingResponse
from pydantic import Field

from hide_tasks.suite import SUITE
from server import board_exports, evaluations, standings
from server.access import Router, Scope, needs
from server.deps import EvaluationId, Reading, TheHub
from server.exports import (
    MEDIA_TYPES,
    SUFFIXES,
    EvaluationFormat,
    Exported,
    TableFormat,
    require_papers,
)
from server.schemas.common import Verdict
from server.standings import BoardQuery
from server.suites import without_version

router = Router(tags=["exports"])


class BoardExport(BoardQuery):
    """What of a leaderboard is given out, and how."""

    format: TableFormat = TableFormat.CSV
    table: bool = Field(False, description="Of LaTeX: the whole table, not only its rows.")


def of_formats(formats: type[StrEnum]) -> dict[int | str, dict[str, Any]]:
    """The answers of a route that gives out these formats."""
    content: dict[str, Any] = {MEDIA_TYPES[one].partition(";")[0]: {} for one in formats}
    return {200: {"description": "The file.", "content": content}}


def named(what: str, suite: str, *more: str) -> str:
    """The name of a file; a suite that is not the paper's stands in it."""
    return "-".join([what, *([] if suite == SUITE else [suite]), *more])


def file_of(pieces: Iterator[bytes], name: str, format: str) -> StreamingResponse:
    """A file to be kept, as it is made."""
    file = f"{name}.{SUFFIXES.get(format, format)}"
    headers = {
        "Content-Disposition": f'attachment; filename="{file}"',
        "Cache-Control": "no-store",
    }
    return StreamingResponse(pieces, media_type=MEDIA_TYPES[format], headers=headers)


@router.get(
    "/evaluations/{evaluation}/export",
    response_class=StreamingResponse,
    responses=of_formats(EvaluationFormat),
)
@needs(Scope.READ)
def export_evaluation(
    evaluation: EvaluationId,
    hub: TheHub,
    format: EvaluationFormat = EvaluationFormat.JSON,
    verdict: Verdict = "success",
) -> StreamingResponse:
    """An evaluation as a file: JSON, CSV by episode, JSON lines with all decisions, the LaTeX row
    of the paper's table (by `verdict`; of suite `hide` alone), or a zip with all of them."""
    with hub.database.reading() as session:
        stands = evaluations.get(session, evaluation)
    require_papers(format, without_version(stands.suite))
    exported = Exported(hub.database, stands, verdict)
    return file_of(exported.pieces(format), stands.id, format.value)


@router.get(
    "/leaderboard/export", response_class=StreamingResponse, responses=of_formats(TableFormat)
)
@needs(Scope.READ)
def export_leaderboard(
    session: Reading, wanted: Annotated[BoardExport, Query()]
) -> StreamingResponse:
    """The leaderboard as a file, with the rows, columns and order that are asked for: JSON, CSV,
    or LaTeX: rows of the paper's table, or with `table` all of it; of suite `hide` alone."""
    require_papers(wanted.format, wanted.suite)
    board = standings.of(session, wanted)
    pieces = board_exports.of_leaderboard(board, wanted.format, table=wanted.table)
    name = named("leaderboard", wanted.suite, wanted.split, wanted.verdict)
    return file_of(pieces, name, wanted.format.value)
