"""Tasks and the leaderboard."""

from hide_tasks.contract import Split
from server import leaderboard, tasks
from server.access import Router, Scope, needs
from server.deps import Reading
from server.revalidation import Revalidate
from server.schemas import Leaderboard, TaskPublic, Verdict

router = Router(tags=["catalogue"])


@router.get("/tasks")
@needs(Scope.READ)
def list_tasks() -> list[TaskPublic]:
    """Every task of the suite."""
    return tasks.catalogue()


@router.get("/tasks/{task}")
@needs(Scope.READ)
def get_task(task: str) -> TaskPublic:
    """One task: language, variations, hidden state, certificate."""
    return tasks.task(task)


@router.get("/leaderboard")
@needs(Scope.READ)
def get_leaderboard(
    session: Reading,
    revalidate: Revalidate,
    split: Split = "test",
    verdict: Verdict = "success",
) -> Leaderboard:
    """Complete evaluations of the whole suite, best first, with the ranks that chance leaves."""
    standing = leaderboard.standing(session, split)
    revalidate.unless(split, verdict, standing, leaderboard.columns())
    return leaderboard.leaderboard(session, split=split, verdict=verdict)
