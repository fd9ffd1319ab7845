"""What workers report (workers/protocol.py); each attempt has a token of its own."""

import asyncio
import logging

from fastapi import Request, Response
from starlette.requests import ClientDisconnect

from server import blobs, lifecycle
from server.access import Gate, Router, needs
from server.commit import commit
from server.deps import AttemptId, TheHub, assigned
from server.files import File
from server.growing import TooLarge
from server.hub import Hub
from server.models import Attempt
from server.problems import Problem, not_found
from workers.protocol import Committed, EpisodeCommit, Fault, Stored

logger = logging.getLogger(__name__)
router = Router(prefix="/attempts/{attempt}")
EPISODE = "/episodes/{episode}"


@router.post(EPISODE + "/start", status_code=204)
@needs(Gate.WORKER)
def start(attempt: AttemptId, episode: str, hub: TheHub) -> Response:
    """The worker begins to play an episode."""
    with hub.database.writing() as session:
        lifecycle.begin(session, *assigned(session, attempt, episode))
    return Response(status_code=204)


@router.put(EPISODE + "/recording")
@needs(Gate.WORKER)
async def receive_recording(
    attempt: AttemptId, episode: str, request: Request, hub: TheHub
) -> Stored:
    """The recording, while it is written; another one replaces it."""
    await asyncio.to_thread(_require_playing, hub, attempt, episode)
    growing = hub.recordings.open(episode)
    try:
        stored = await growing.fill(request.stream())
        growing.place = hub.blobs.path(stored.sha256)
        await asyncio.to_thread(hub.blobs.take, growing.path, stored.sha256)
    except ClientDisconnect:
        hub.recordings.forget(episode, growing)
        raise Problem(400, "broken_off", "The recording broke off.") from None
    except TooLarge as error:
        hub.recordings.forget(episode, growing)
        raise Problem(413, "too_large", str(error)) from None
    except FileNotFoundError:  # the attempt was ended, and its recordings were forgotten
        raise Problem(409, "stale_attempt", f"Attempt {attempt} has ended.") from None
    except BaseException:
        hub.recordings.forget(episode, growing)
        raise
    return stored


def _require_playing(hub: Hub, attempt: str, episode: str) -> None:
    with hub.database.reading() as session:
        played, found = assigned(session, attempt, episode)
        lifecycle.require_open(played)
        if found.fence != played.fence:
            raise Problem(409, "stale_attempt", f"Attempt {attempt} does not play {episode}.")


@router.put(EPISODE + "/result")
@needs(Gate.WORKER)
def receive_result(attempt: AttemptId, episode: str, what: EpisodeCommit, hub: TheHub) -> Committed:
    """A finished episode; the same one twice is fine."""
    with hub.database.writing() as session:
        outcome = commit(session, hub.blobs, *assigned(session, attempt, episode), what)
    hub.recordings.forget(episode)
    if isinstance(outcome, Problem):
        logger.error("An episode went differently the second time", extra={"episode": episode})
        raise outcome
    if not outcome.already:
        hub.metrics.count(what.result)
    return outcome


@router.post(EPISODE + "/fault", status_code=204)
@needs(Gate.WORKER)
def receive_fault(attempt: AttemptId, episode: str, fault: Fault, hub: TheHub) -> Response:
    """The episode could not be played; the attempt goes on with its others."""
    with hub.database.writing() as session:
        played, found = assigned(session, attempt, episode)
        lifecycle.put_back(session, played, found, fault.reason)
    hub.recordings.forget(episode)
    return Response(status_code=204)


@router.get("/checkpoint")
@needs(Gate.WORKER)
def give_checkpoint(attempt: AttemptId, hub: TheHub) -> File:
    """The file of the policy that the attempt plays."""
    with hub.database.reading() as session:
        playing = session.get_one(Attempt, attempt)
        lifecycle.require_open(playing)
        spec = playing.shard.evaluation.policy_version.spec
    if spec["kind"] != "checkpoint" or not hub.blobs.holds(spec["sha256"]):
        raise not_found("checkpoint of attempt", attempt)
    return File(hub.blobs.path(spec["sha256"]), media_type=blobs.CHECKPOINT)
