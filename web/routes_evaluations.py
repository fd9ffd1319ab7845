"""Evaluations: the list."""

from typing import Annotated

from fastapi import Request
from fastapi.responses import HTMLResponse

from server import evaluations, policies
from server.access import Router, Scope, needs
from server.deps import Reading
from server.states import EvaluationState
from web.filters import EMPTY_IS_NONE
from web.templating import page

router = Router(include_in_schema=False)

LISTED = 50


@router.get("/evaluations")
@needs(Scope.READ)
def list_evaluations(
    request: Request,
    session: Reading,
    state: Annotated[EvaluationState | None, EMPTY_IS_NONE] = None,
    policy: Annotated[str | None, EMPTY_IS_NONE] = None,
    cursor: str | None = None,
) -> HTMLResponse:
    """Evaluations, latest first."""
    found = evaluations.listed(session, state=state, policy=policy, limit=LISTED, cursor=cursor)
    names = list(dict.fromkeys(version.policy for version in policies.versions(session)))
    shown = {
        "found": found,
        "states": list(EvaluationState),
        "policies": names,
        "state": state,
        "policy": policy,
        "cursor": cursor,
    }
    return page(request, "evaluations.html", shown)
