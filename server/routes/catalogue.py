"""Tasks and the leaderboard."""

from typing import Annotated

from fastapi import Query

from hide_tasks.suite import SUITE
from server import leaderboard, published, standings, tasks
from server.access import Router, Scope, needs
from server.deps import Reading
from server.revalidation import Revalidate
from server.schemas.leaderboard import Leaderboard, PublishedPublic
from server.schemas.tasks import TaskPublic
from server.standings import BoardQuery
from server.suites import BoardName

router = Router(tags=["catalogue"])


@router.get("/tasks")
@needs(Scope.READ)
def list_tasks(suite: BoardName = SUITE) -> list[TaskPublic]:
    """Every task of a suite."""
    return tasks.catalogue(suite)


@router.get("/tasks/{task}")
@needs(Scope.READ)
def get_task(task: str) -> TaskPublic:
    """One task: language, variations, hidden state, certificate."""
    return tasks.task(task)


@router.get("/leaderboard")
@needs(Scope.READ)
def get_leaderboard(
    session: Reading, revalidate: Revalidate, wanted: Annotated[BoardQuery, Query()]
) -> Leaderboard:
    """Complete evaluations of the whole suite, best first, with the ranks that chance leaves.

    Filters leave out rows, `category` columns; ranks are those among all policies.
    """
    standing = leaderboard.standing(session, wanted.split)
    revalidate.unless(wanted.model_dump_json(), standing, leaderboard.columns(wanted.suite))
    return standings.of(session, wanted)


@router.get("/leaderboard/published")
@needs(Scope.READ)
def get_published() -> PublishedPublic:
    """What the paper printed of suite `hide`. It was measured in another simulator, and is not
    comparable."""
    return published.published()
