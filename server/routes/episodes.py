"""Episodes: filtered, one by one, with decisions, hidden states and recordings."""

import asyncio
from contextlib import suppress
from typing import Annotated, Literal

from fastapi import Query, Response
from fastapi.responses import StreamingResponse
from pydantic import Field
from sqlalchemy.orm import Session
from starlette.types import Send

from server import blobs, episodes, evaluations, partings, pictures
from server.access import Router, Scope, needs
from server.deps import Cursor, EpisodeId, EvaluationId, Limit, Reading, TheHub
from server.episode_order import Sort
from server.files import File
from server.growing import BrokenOff, Growing
from server.hub import Hub
from server.problems import not_found
from server.revalidation import FOR_EVER, Revalidate, Revalidation
from server.schemas.common import Page
from server.schemas.episodes import (
    ChangePublic,
    DecisionPublic,
    EpisodeDetail,
    EpisodePublic,
    PartingPublic,
    RunPublic,
    SpanPublic,
)
from server.states import EpisodeState
from server.wanted import Wanted, Within

router = Router(tags=["episodes"])
NEVER = {"Cache-Control": "no-store"}
PATIENCE = 5.0  # s to wait for the first bytes of a running episode's recording
Camera = Literal["front", "left_shoulder", "right_shoulder", "wrist"]  # contract.CAMERAS


class Followed(StreamingResponse):
    """A growing recording; when it breaks off, the answer stays unfinished and its reader knows."""

    async def stream_response(self, send: Send) -> None:
        with suppress(BrokenOff):
            await super().stream_response(send)


class WithinFilter(Within):
    """A page of the episodes of an evaluation."""

    sort: Sort = Sort.NEWEST
    limit: Limit = 50
    cursor: Cursor = None


class EpisodeFilter(Wanted):
    """A page of the episodes of all evaluations."""

    sort: Sort = Sort.NEWEST
    limit: Limit = 50
    cursor: Cursor = None


@router.get("/episodes")
@needs(Scope.READ)
def list_episodes(
    session: Reading, wanted: Annotated[EpisodeFilter, Query()]
) -> Page[EpisodePublic]:
    """Episodes of all evaluations, those of the newest first unless another order is wanted."""
    return episodes.listed(session, **dict(wanted))


@router.get("/evaluations/{evaluation}/episodes")
@needs(Scope.READ)
def list_episodes_of_evaluation(
    evaluation: EvaluationId, session: Reading, wanted: Annotated[WithinFilter, Query()]
) -> Page[EpisodePublic]:
    """Episodes of one evaluation, by task and index."""
    return episodes.listed(session, evaluation=evaluation, **dict(wanted))


@router.get("/episodes/{episode}")
@needs(Scope.READ)
def get_episode(episode: str, session: Reading) -> EpisodeDetail:
    """One episode: verdicts, hashes, timing."""
    return episodes.get(session, episode)


@router.get("/episodes/{episode}/decisions")
@needs(Scope.READ)
def list_decisions(episode: str, session: Reading, revalidate: Revalidate) -> list[DecisionPublic]:
    """Every decision with the hidden state after it."""
    _unless_final(session, episode, revalidate)
    return episodes.decisions(session, episode)


@router.get("/episodes/{episode}/changes")
@needs(Scope.READ)
def list_changes(episode: str, session: Reading, revalidate: Revalidate) -> list[ChangePublic]:
    """The hidden state at the start and after each of its changes, seen 20 times a second."""
    _unless_final(session, episode, revalidate)
    return episodes.changes(session, episode)


@router.get("/episodes/{episode}/spans")
@needs(Scope.READ)
def list_spans(episode: str, session: Reading, revalidate: Revalidate) -> list[SpanPublic]:
    """What held from when to when: hidden values, the stage, beliefs."""
    _unless_final(session, episode, revalidate)
    return episodes.spans(session, episode)


def _unless_final(session: Session, episode: str, revalidate: Revalidation) -> None:
    """What was measured of a final episode never changes, so it need not be read again."""
    row = episodes.row(session, episode)
    if row.state == EpisodeState.FINAL:
        revalidate.unless(row.id, row.digest)


@router.get(
    "/episodes/{episode}/thumbnail.jpg",
    response_class=File,
    responses={200: {"content": {blobs.JPEG: {}}}},
)
@needs(Scope.READ)
def get_thumbnail(episode: str, session: Reading, hub: TheHub) -> File:
    """What the front camera saw last."""
    sha256 = episodes.row(session, episode).thumbnail
    if sha256 is None or not hub.blobs.holds(sha256):
        raise not_found("thumbnail of episode", episode)
    return File(hub.blobs.path(sha256), media_type=blobs.JPEG, headers=FOR_EVER)


@router.get(
    "/episodes/{episode}/preview.webp",
    response_class=Response,
    responses={200: {"content": {pictures.WEBP: {}}}},
)
@needs(Scope.READ)
def get_preview(episode: str, session: Reading, hub: TheHub) -> Response:
    """What the front camera saw, animated, a frame a decision."""
    content = pictures.preview(hub.blobs, episodes.row(session, episode))
    return Response(content, media_type=pictures.WEBP, headers=FOR_EVER)


@router.get(
    "/episodes/{episode}/observations/{decision}/{camera}.jpg",
    response_class=Response,
    responses={200: {"content": {blobs.JPEG: {}}}},
)
@needs(Scope.READ)
def get_observation(
    episode: str,
    decision: Annotated[int, Field(ge=0, le=100_000)],
    camera: Camera,
    session: Reading,
    hub: TheHub,
) -> Response:
    """What a camera saw before a decision; one after the last: at the end."""
    row = episodes.row(session, episode)
    content = pictures.observation(hub.blobs, row, decision, camera)
    return Response(content, media_type=blobs.JPEG, headers=FOR_EVER)


@router.get("/episodes/{episode}/parting")
@needs(Scope.READ)
def get_parting(
    episode: str, session: Reading, other: Annotated[str | None, Query(max_length=40)] = None
) -> PartingPublic:
    """Where it parts from another run of the same episode; without `other`, the expert's."""
    return partings.of(session, episode, other)


@router.get("/episodes/{episode}/runs")
@needs(Scope.READ)
def list_runs_of_same(episode: str, session: Reading) -> list[RunPublic]:
    """Other policies' runs of the same episode, the newest of each version."""
    return partings.runs_of_same(session, episode)


@router.get(
    "/episodes/{episode}/recording.rrd",
    response_class=Response,
    responses={200: {"content": {blobs.RRD: {}}}},
)
@needs(Scope.READ)
async def get_recording(episode: EpisodeId, hub: TheHub) -> Response:
    """The recording; that of a running episode comes as it grows, from its first byte."""
    growing = await _coming_in(hub, episode)
    if growing is not None:
        return Followed(growing.follow(), media_type=blobs.RRD, headers=NEVER)
    sha256 = await asyncio.to_thread(_recording, hub, episode)
    if sha256 is None or not hub.blobs.holds(sha256):
        raise not_found("recording of episode", episode)
    return File(hub.blobs.path(sha256), media_type=blobs.RRD, headers=FOR_EVER)


async def _coming_in(hub: Hub, episode: str) -> Growing | None:
    for _ in range(int(PATIENCE / 0.1)):
        growing = hub.recordings.get(episode)
        if growing is not None or not await asyncio.to_thread(_expected, hub, episode):
            return growing
        await asyncio.sleep(0.1)
    return None


def _recording(hub: Hub, episode: str) -> str | None:
    with hub.database.reading() as session:
        return episodes.recording_of(episodes.row(session, episode))


def _expected(hub: Hub, episode: str) -> bool:
    with hub.database.reading() as session:
        return _is_running(session, episode)


def _is_running(session: Session, episode: str) -> bool:
    row = episodes.row(session, episode)
    recorded = evaluations.row(session, row.evaluation_id).recordings
    return row.state == EpisodeState.RUNNING and recorded
