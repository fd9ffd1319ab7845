"""What Prometheus scrapes; it stands at /metrics, where scrapers look."""

from typing import Annotated

from fastapi import Header, Response

from server.access import Router, Scope, needs
from server.deps import TheHub

router = Router()


@router.get("/metrics")
@needs(Scope.READ)
def show_metrics(hub: TheHub, accept: Annotated[str, Header()] = "") -> Response:
    """How the server does, as text; a scraper shows a token with the scope read."""
    content, media_type = hub.metrics.text(accept)
    return Response(content, headers={"Content-Type": media_type})
