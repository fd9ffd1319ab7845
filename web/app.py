"""The server's application with its pages; uvicorn loads it by name."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

import server.app
from server.settings import Settings
from web import (
    routes_ablations,
    routes_account,
    routes_batches,
    routes_comparisons,
    routes_demo,
    routes_episodes,
    routes_evaluation,
    routes_evaluations,
    routes_failures,
    routes_leaderboard,
    routes_people,
    routes_policies,
    routes_snapshots,
    routes_submit,
    routes_tasks,
    routes_viewer,
    routes_webhooks,
)
from web.compression import Compression
from web.errors import show_error_pages
from web.security import SecurityHeaders
from web.templating import STATIC, fingerprint
from web.viewer_assets import ViewerAssets

ROUTES = (
    routes_leaderboard,
    routes_demo,
    routes_snapshots,
    routes_comparisons,
    routes_ablations,
    routes_submit,
    routes_evaluations,
    routes_evaluation,
    routes_failures,
    routes_batches,
    routes_policies,
    routes_episodes,
    routes_tasks,
    routes_viewer,
    routes_account,
    routes_webhooks,
    routes_people,
)


def create_app(settings: Settings) -> FastAPI:
    """The API and, beside it, the pages for people."""
    app = server.app.create_app(settings)
    app.state.viewer = ViewerAssets(app.state.settings.data)
    for routes in ROUTES:
        app.include_router(routes.router)
    app.mount("/static", StaticAssets(directory=STATIC), name="static")
    show_error_pages(app)
    app.add_middleware(Compression)
    app.add_middleware(SecurityHeaders)
    _prepare_viewer_at_start(app)
    return app


class StaticAssets(StaticFiles):
    """Files of `static/`; one asked for with its content's hash never has to be asked for again."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        asked = scope["query_string"].decode("latin-1")
        kept = asked.startswith("v=") and asked[2:] == fingerprint(path)
        rule = "public, max-age=31536000, immutable" if kept else "no-cache"
        response.headers["Cache-Control"] = rule
        return response


def _prepare_viewer_at_start(app: FastAPI) -> None:
    inner = app.router.lifespan_context

    @asynccontextmanager
    async def lifespan(app: Any) -> AsyncIterator[Any]:
        async with inner(app) as state:
            app.state.viewer.begin()
            yield state

    app.router.lifespan_context = lifespan
