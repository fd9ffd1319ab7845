"""What routes are given: the hub, sessions, and the rows that a path names."""

import hmac
from collections.abc import Iterator
from typing import Annotated

from fastapi import Depends, Header, Query, Request
from sqlalchemy.orm import Session

from hide_tasks.contract import Split
from hide_tasks.suite import SUITE
from server import episodes, evaluations
from server.access import Principal
from server.hub import Hub
from server.lifecycle import hash_token
from server.models import Attempt, Episode
from server.paging import MOST
from server.problems import Problem, not_found
from server.suites import BoardName, Place


def _hub(request: Request) -> Hub:
    hub: Hub = request.app.state.hub
    return hub


TheHub = Annotated[Hub, Depends(_hub)]


def _principal(request: Request) -> Principal:
    """Whoever was let in; a route that is open to anybody has no use for this."""
    principal: Principal = request.state.principal
    return principal


ThePrincipal = Annotated[Principal, Depends(_principal)]


def _reading(hub: TheHub) -> Iterator[Session]:
    with hub.database.reading() as session:
        yield session


Reading = Annotated[Session, Depends(_reading)]
Limit = Annotated[int, Query(ge=1, le=MOST, description="Items of a page.")]
Cursor = Annotated[
    str | None, Query(max_length=500, description="`next` of the page before, unchanged.")
]


def _place(
    suite: Annotated[BoardName, Query(description="Of policies: where they are compared.")] = SUITE,
    split: Annotated[Split, Query(description="Of policies: where they are compared.")] = "test",
) -> Place:
    return Place(suite, split)


ThePlace = Annotated[Place, Depends(_place)]


def _evaluation_id(evaluation: str, hub: TheHub) -> str:
    """Its session is short: one of `Reading` stays open while an answer is sent, perhaps hours."""
    with hub.database.reading() as session:
        return evaluations.row(session, evaluation).id


def _episode_id(episode: str, hub: TheHub) -> str:
    with hub.database.reading() as session:
        return episodes.row(session, episode).id


EvaluationId = Annotated[str, Depends(_evaluation_id)]
EpisodeId = Annotated[str, Depends(_episode_id)]


def _attempt_id(
    attempt: str, hub: TheHub, authorization: Annotated[str | None, Header()] = None
) -> str:
    """The attempt whose token the worker shows."""
    scheme, _, token = (authorization or "").partition(" ")
    if scheme != "Bearer" or not token:
        raise Problem(401, "no_token", "Authorization: Bearer and the attempt's token is wanted.")
    with hub.database.reading() as session:
        found = session.get(Attempt, attempt)
        known = found.token_hash if found else ""
    if not hmac.compare_digest(known, hash_token(token)):
        raise Problem(401, "wrong_token", f"This is not the token of attempt {attempt[:40]}.")
    return attempt


AttemptId = Annotated[str, Depends(_attempt_id)]


def assigned(session: Session, attempt: str, episode: str) -> tuple[Attempt, Episode]:
    """An attempt and an episode of its shard.

    Raises:
        Problem: 404, the episode is not of this attempt's shard.
    """
    played = session.get_one(Attempt, attempt)
    found = session.get(Episode, episode)
    if found is None or found.shard_id != played.shard_id:
        raise not_found("episode of this attempt", episode)
    return played, found
