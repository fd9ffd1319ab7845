"""Evaluations and the leaderboard as files."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Any

from fastapi.responses import StreamingResponse

from hide_tasks.contract import Split
from server import evaluations, exports, leaderboard
from server.access import Router, Scope, needs
from server.deps import EvaluationId, Reading, TheHub
from server.exports import MEDIA_TYPES, SUFFIXES, EvaluationFormat, Exported, LeaderboardFormat
from server.schemas import Verdict

router = Router(tags=["exports"])


def of_formats(formats: type[StrEnum]) -> dict[int | str, dict[str, Any]]:
    """The answers of a route that gives out these formats."""
    content: dict[str, Any] = {MEDIA_TYPES[one].partition(";")[0]: {} for one in formats}
    return {200: {"description": "The file.", "content": content}}


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
    of the paper's table (by `verdict`), or a zip with all of them."""
    with hub.database.reading() as session:
        stands = evaluations.get(session, evaluation)
    exported = Exported(hub.database, stands, verdict)
    return file_of(exported.pieces(format), stands.id, format.value)


@router.get(
    "/leaderboard/export", response_class=StreamingResponse, responses=of_formats(LeaderboardFormat)
)
@needs(Scope.READ)
def export_leaderboard(
    session: Reading,
    format: LeaderboardFormat = LeaderboardFormat.CSV,
    split: Split = "test",
    verdict: Verdict = "success",
) -> StreamingResponse:
    """The leaderboard as a file: JSON, CSV, or LaTeX rows of the paper's table."""
    board = leaderboard.leaderboard(session, split=split, verdict=verdict)
    name = f"leaderboard-{split}-{verdict}"
    return file_of(exports.of_leaderboard(board, format), name, format.value)
