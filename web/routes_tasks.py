"""The tasks: what each asks, what it hides, and what a score on it means."""

from typing import Annotated

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.catalogue import suite_of
from hide_tasks.contract import Category
from hide_tasks.suite import SUITE
from server import leaderboard, tasks
from server.access import Router, Scope, needs
from server.deps import Reading
from server.problems import invalid
from server.schemas.common import RatePublic, Verdicts
from server.schemas.leaderboard import LeaderboardRow
from server.schemas.tasks import CertificatePublic, TaskPublic
from server.suites import BOARDS, BoardName
from web.aliases import clearest
from web.templating import page

router = Router(include_in_schema=False)

BEST = 5  # policies of a task's page


@router.get("/tasks")
@needs(Scope.READ)
def list_tasks(request: Request, suite: Annotated[BoardName, Query()] = SUITE) -> HTMLResponse:
    """The tasks of a suite, by category."""
    shown = {"suite": suite, "suites": [*BOARDS], "groups": by_category(suite)}
    return page(request, "tasks.html", shown)


def by_category(suite: str) -> list[tuple[Category, list[TaskPublic]]]:
    """The tasks of a suite; a category without any is left out."""
    found = tasks.catalogue(suite)
    groups = [(kind, [task for task in found if task.category is kind]) for kind in Category]
    return [(kind, some) for kind, some in groups if some]


@router.get("/tasks/{name}")
@needs(Scope.READ)
def show_task(
    request: Request,
    session: Reading,
    name: str,
    pair: Annotated[int | None, Query(ge=1, le=99)] = None,
) -> HTMLResponse:
    """One task; `pair` chooses which of its alias pairs is shown large."""
    task = tasks.task(name)
    if pair is not None and pair > len(task.aliases):
        raise invalid("pair", f"is {pair}; {name} has {len(task.aliases)} alias pairs")
    number = pair or clearest(task.aliases)
    shown = {
        "task": task,
        "pair": number,
        "chosen": task.aliases[number - 1] if number else None,
        "measured": measured(task.certificate),
        "best": best(session, name),
    }
    return page(request, "task.html", shown)


def measured(proof: CertificatePublic | None) -> Verdicts | None:
    """What the amnesiac reached, with its intervals."""
    if proof is None:
        return None
    success, exact = (
        RatePublic.of(round(rate * proof.episodes), proof.episodes)
        for rate in (proof.amnesiac_success, proof.amnesiac_exact)
    )
    return Verdicts(success=success, exact=exact)


def best(session: Session, task: str) -> list[LeaderboardRow]:
    """The rows of the leaderboard that do best on a task; of equals, the ranked ones first."""
    of = suite_of(task)
    board = leaderboard.leaderboard(session, split="test", verdict="success", of=of)

    def place(row: LeaderboardRow) -> tuple[float, float, bool]:
        verdicts = row.tasks[task]
        return (-(verdicts.success.value or 0), -(verdicts.exact.value or 0), row.reference)

    return sorted(board.rows, key=place)[:BEST]
