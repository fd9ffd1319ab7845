"""Two policies on the same episodes."""

from typing import Annotated

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.contract import Split
from server import comparisons, policies
from server.access import Router, Scope, needs
from server.deps import Reading
from server.problems import Problem
from server.schemas import Comparison, Verdict
from web.templating import page

router = Router(include_in_schema=False)

SPLITS: tuple[Split, ...] = ("test", "val", "train")
Side = Annotated[str, Query(max_length=100)]


@router.get("/comparisons")
@needs(Scope.READ)
def show_comparison(
    request: Request,
    session: Reading,
    a: Side = "",
    b: Side = "",
    split: Annotated[Split, Query()] = "test",
    verdict: Annotated[Verdict, Query()] = "success",
) -> HTMLResponse:
    """The form, and the comparison that the address asks for, or why there is none."""
    found: Comparison | None = None
    problem: Problem | None = None
    if a and b:
        try:
            found = compared(session, a.strip(), b.strip(), split, verdict)
        except Problem as error:
            problem = error
    shown = {
        "names": [f"{one.policy}@{one.version}" for one in policies.versions(session)],
        "asked": {"a": a, "b": b, "split": split, "verdict": verdict},
        "splits": SPLITS,
        "found": found,
        "problem": problem.detail if problem else "",
    }
    return page(request, "comparison.html", shown, status=problem.status if problem else 200)


def compared(session: Session, a: str, b: str, split: Split, verdict: Verdict) -> Comparison:
    """Two policies, or evaluations.

    Raises:
        Problem: 409 or 422, they cannot be compared; it says why.
    """
    one = comparisons.find(session, "a", a, split)
    other = comparisons.find(session, "b", b, split)
    return comparisons.compare(session, one, other, verdict=verdict)
