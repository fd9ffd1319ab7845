"""What machines are told that join the cluster; for programs of this project alone."""

from server.access import Router, Scope, needs
from server.deps import TheHub
from server.problems import Problem
from workers.engines.membership import Membership

router = Router(include_in_schema=False)


@router.get("/cluster")
@needs(Scope.WORK)
def tell_members(hub: TheHub) -> Membership:
    """Where the scheduler is, with the certificate and key of the cluster."""
    if not hub.membership:
        raise Problem(404, "no_cluster", "This server has no cluster; see hide serve --scheduler.")
    return hub.membership
