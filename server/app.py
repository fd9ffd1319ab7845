"""The API application; web/app.py adds the pages to it."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from anyio import to_thread
from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi

from hide_tasks.machine import installed
from server import problems, revalidation
from server.access import Gate, Scope, declared, require_declared
from server.admission import Admission
from server.guard import Guard
from server.hub import Hub
from server.metrics import RequestTimes
from server.routes import (
    batches,
    catalogue,
    cluster,
    comparisons,
    episodes,
    evaluations,
    exports,
    facets,
    health,
    history,
    internal,
    labels,
    metrics,
    people,
    policies,
    reruns,
    snapshots,
    uploads,
    waiting,
    webhooks,
)
from server.schemas.operation import ProblemDocument
from server.settings import Settings
from workers.protocol import INTERNAL

API = "/api/v1"
# Requests that are worked on at once; the others wait. Pages cost processor time, and the usual 40
# threads lose part of it by taking it from each other: all are late, and some very late.
THREADS = 8
PROBLEM = {problems.MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemDocument"}}}
TOKEN = {
    "type": "http",
    "scheme": "bearer",
    "description": "A token of this server, with the scope that the operation names. A server that "
    "only its own machine reaches asks for none, and the pages' cookie does as well.",
}
UNCHANGED = {"description": "The client has it: its ETag is in If-None-Match."}
ANY_PROBLEM: dict[int | str, dict[str, Any]] = {
    401: {"description": "It is not known who asks.", "content": PROBLEM},
    403: {"description": "Whoever asks may not.", "content": PROBLEM},
    404: {"description": "There is no such thing.", "content": PROBLEM},
    409: {"description": "Its state does not allow it.", "content": PROBLEM},
    422: {"description": "The request is wrong; `errors` says where.", "content": PROBLEM},
    429: {"description": "Too often, or a quota is used up.", "content": PROBLEM},
    "default": {"description": "Any other problem.", "content": PROBLEM},
}


def create_app(settings: Settings) -> FastAPI:
    """The API with its ledger open; work is handed out once it is served.

    Raises:
        DataFolderError, LedgerError: the data folder cannot be used.
    """
    hub = Hub.opened(settings)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        require_declared(app)  # here, for others add routes to the application
        to_thread.current_default_thread_limiter().total_tokens = THREADS
        try:
            hub.start()
            yield
        finally:
            hub.stop()

    app = FastAPI(
        title="HIDE-SEEK",
        version=installed("hide-seek") or "0",
        description="Evaluates policies that must remember. Additive changes only within v1.",
        openapi_url=f"{API}/openapi.json",
        docs_url=None,  # its page loads scripts from elsewhere
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.hub = hub
    app.state.settings = settings
    app.state.admit = Admission(hub)
    app.include_router(_api(), prefix=API, responses=ANY_PROBLEM)
    app.include_router(internal.router, prefix=INTERNAL, include_in_schema=False)
    app.include_router(metrics.router, include_in_schema=False)
    app.add_middleware(Guard, hosts=settings.hosts)
    app.add_middleware(RequestTimes, times=hub.metrics.requests)
    problems.install(app)
    revalidation.install(app)
    app.openapi = lambda: _described(app)  # type: ignore[method-assign]
    return app


def _described(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, with what every route may answer."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title,
            version=app.version,
            description=app.description,
            routes=app.routes,
        )
        document["components"]["securitySchemes"] = {"token": TOKEN}
        for (path, method), need in declared(app).items():
            if need is not Gate.PUBLIC and (found := document["paths"].get(path, {}).get(method)):
                scopes = [need.value] if isinstance(need, Scope) else []
                found["security"] = [{"token": scopes}]
        problem = ProblemDocument.model_json_schema()
        document["components"]["schemas"]["ProblemDocument"] = problem
        for path in document["paths"].values():
            if "get" in path:
                path["get"]["responses"]["304"] = UNCHANGED
        app.openapi_schema = document
    return app.openapi_schema


def _api() -> APIRouter:
    api = APIRouter()
    for routes in (
        catalogue,
        policies,
        uploads,
        evaluations,
        batches,
        waiting,
        history,
        facets,  # before one episode, whose id may be anything
        episodes,
        reruns,
        labels,
        exports,
        snapshots,
        comparisons,
        people,
        webhooks,
        health,
        cluster,
    ):
        api.include_router(routes.router)
    return api
