"""The demo: two reference policies on a few episodes, begun by one click."""

from fastapi import Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from server import demo, evaluations
from server.access import Router, Scope, needs
from server.deps import Reading, TheHub, ThePrincipal
from server.routes.evaluations import queued
from server.states import EvaluationState
from web.templating import page

PATH = "/demo"
router = Router(prefix=PATH, include_in_schema=False)


@router.get("")
@needs(Scope.READ)
def show_demo(
    request: Request, session: Reading, hub: TheHub, principal: ThePrincipal
) -> HTMLResponse:
    """How far the demo is, and what to look at when it is done."""
    found = {
        policy: evaluations.public(session, row)
        for policy, row in demo.found(session, principal).items()
    }
    states = [one.state for one in found.values()]
    shown = {
        "found": found,
        "tasks": demo.TASKS,
        "episodes": demo.EPISODES * len(demo.TASKS),
        "workers": bool(hub.engine),
        "begun": len(found) == len(demo.POLICIES),
        "done": len(states) == 2 and set(states) == {EvaluationState.COMPLETED},
        "may_begin": principal.may(Scope.SUBMIT) and bool(demo.due(session, principal)),
    }
    return page(request, "demo.html", shown)


@router.post("")
@needs(Scope.SUBMIT)
def begin_demo(hub: TheHub, principal: ThePrincipal) -> Response:
    """Queues what the demo lacks; asking twice is fine."""
    with hub.database.writing() as session:
        for policy, key in demo.due(session, principal).items():
            queued(session, hub, principal, demo.wanted(policy), key)
    hub.bell.reconciler.set()
    return RedirectResponse(PATH, 303)
