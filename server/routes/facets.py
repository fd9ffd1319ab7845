"""What the episodes of a filter differ in, counted, and all of them as a file."""

from typing import Annotated

from fastapi import Query
from fastapi.responses import StreamingResponse

from server import exports, facets
from server.access import Router, Scope, needs
from server.deps import Reading, TheHub
from server.episode_order import Sort
from server.exports import EpisodesFormat
from server.routes.exports import file_of, of_formats
from server.schemas.episodes import EpisodeFacets
from server.wanted import Wanted

router = Router(tags=["episodes"])


class ExportFilter(Wanted):
    """Which episodes, and how they are given out."""

    sort: Sort = Sort.NEWEST
    format: EpisodesFormat = EpisodesFormat.CSV


@router.get("/episodes/facets")
@needs(Scope.READ)
def count_episodes(session: Reading, wanted: Annotated[Wanted, Query()]) -> EpisodeFacets:
    """How many episodes of a filter there are, and what they differ in: the values of each field
    with their counts, which respect the filters of the other fields."""
    wanted.require_known()
    return facets.facets(session, wanted)


@router.get(
    "/episodes/export",
    response_class=StreamingResponse,
    responses=of_formats(EpisodesFormat),
)
@needs(Scope.READ)
def export_episodes(hub: TheHub, wanted: Annotated[ExportFilter, Query()]) -> StreamingResponse:
    """The episodes of a filter as a file: a line of CSV or of JSON each."""
    wanted.require_known()
    fields = dict(wanted)
    pieces = exports.of_episodes(hub.database, fields.pop("format"), **fields)
    return file_of(pieces, "episodes", wanted.format.value)
