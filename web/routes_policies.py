"""A policy's version: what it plays, what was tried of it, how it did."""

from fastapi import Request
from fastapi.responses import HTMLResponse

from server import evaluations, policies
from server.access import Router, Scope, needs
from server.deps import Reading
from server.routes.policies import get_policy
from web.templating import page

router = Router(include_in_schema=False)

LISTED = 20


@router.get("/policies/{policy}")
@needs(Scope.READ)
def show_policy(request: Request, session: Reading, policy: str) -> HTMLResponse:
    """One version, by id, name (the newest) or name@version."""
    version = get_policy(policy, session)
    others = (one for one in policies.versions(session) if one.policy == version.policy)
    shown = {
        "version": version,
        "others": [one for one in others if one.id != version.id],
        "found": evaluations.listed(session, policy=version.policy, limit=LISTED),
    }
    return page(request, "policy.html", shown)
