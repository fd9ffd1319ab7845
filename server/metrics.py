"""What a Prometheus server scrapes: how long requests take, and how the ledger stands.

The ledger is asked at each scrape, by indexes alone, so it may hold a million episodes; what would
have to be counted one by one is counted as it happens, and begins at zero with the server.
"""

import logging
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

from prometheus_client import CollectorRegistry, Counter, Histogram, Metric, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from sqlalchemy.orm import Session
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hide_tasks import suite
from hide_tasks.contract import EpisodeResult
from hide_tasks.machine import installed
from server.models import Attempt, Divergence, Episode, Evaluation, Shard, now
from server.states import (
    ENDED,
    AttemptState,
    EpisodeState,
    EvaluationState,
    ShardState,
)

if TYPE_CHECKING:
    from server.hub import Hub

logger = logging.getLogger(__name__)
SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
Value = tuple[dict[str, str], float]  # labels, and what is measured


class Metrics:
    """A running server's."""

    def __init__(self, hub: "Hub"):
        self.registry = CollectorRegistry()
        self.requests = Histogram(
            "hide_request_seconds",
            "From a request to the begin of its answer.",
            ("method", "route", "status"),
            buckets=SECONDS,
            registry=self.registry,
        )
        self.committed = Counter(
            "hide_episodes_committed",
            "Episodes that became final since the server started.",
            ("task", "success"),
            registry=self.registry,
        )
        self.registry.register(LedgerCollector(hub))
        ProcessCollector(registry=self.registry)

    def count(self, result: EpisodeResult) -> None:
        """One more episode is final."""
        self.committed.labels(result.task, str(result.success).lower()).inc()

    def text(self, accept: str) -> tuple[bytes, str]:
        """What is scraped, and its media type, as the scraper likes it."""
        encode, media_type = choose_encoder(accept)
        return encode(self.registry), media_type


class RequestTimes:
    """Times every request, whatever becomes of it."""

    def __init__(self, app: ASGIApp, times: Histogram):
        self.app, self.times = app, times

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began, answered = perf_counter(), False

        async def noted(message: Message) -> None:
            nonlocal answered
            if message["type"] == "http.response.start":
                answered = True
                self._note(scope, message["status"], perf_counter() - began)
            await send(message)

        try:
            await self.app(scope, receive, noted)
        except Exception:
            if not answered:  # the outermost layer will, with a 500
                self._note(scope, 500, perf_counter() - began)
            raise

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "name", None) or "none"
        self.times.labels(scope["method"], route, str(status)).observe(seconds)
        facts = {"method": scope["method"], "path": scope["path"], "route": route}
        facts |= {"status": status, "seconds": round(seconds, 4)}
        logger.info("A request was answered", extra=facts)


@dataclass(eq=False)  # a registry keeps its collectors by identity
class LedgerCollector(Collector):
    """How the ledger, the workers and the disk stand at the moment of a scrape."""

    hub: "Hub"

    def describe(self) -> list[Metric]:
        """Nothing beforehand: registering asks no ledger."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The gauges."""
        version = {"version": installed("hide-seek") or "0"}
        version |= {"suite": f"{suite.SUITE} {suite.VERSION}"}
        yield _gauge("hide_build_info", "Which software answers.", [(version, 1.0)])
        with self.hub.database.reading() as session:
            yield from _ledger(session)
        yield from self._workers()
        yield from self._disk()

    def _workers(self) -> Iterator[Metric]:
        hub = self.hub
        held = len(hub.engine.inventory()) if hub.engine else 0
        fault = float(bool(hub.reconciler and hub.reconciler.fault))
        slots = hub.settings.workers
        yield _gauge("hide_worker_slots", "Shards that may run at a time.", [({}, slots)])
        yield _gauge("hide_engine_attempts", "Attempts that the engine holds.", [({}, held)])
        yield _gauge("hide_reconciler_fault", "1 while the reconciler fails.", [({}, fault)])

    def _disk(self) -> Iterator[Metric]:
        folder = self.hub.folder
        disk = shutil.disk_usage(folder.path)
        ledger = folder.ledger.stat().st_size
        yield _gauge("hide_disk_free_bytes", "Of the data folder's disk.", [({}, disk.free)])
        yield _gauge("hide_disk_size_bytes", "Of the data folder's disk.", [({}, disk.total)])
        yield _gauge("hide_ledger_bytes", "Of the database file.", [({}, ledger)])


def _gauge(name: str, about: str, values: list[Value]) -> Metric:
    labels = list(values[0][0]) if values else []
    family = GaugeMetricFamily(name, about, labels=labels)
    for labelled, value in values:
        family.add_metric(list(labelled.values()), float(value))
    return family


def _ledger(session: Session) -> Iterator[Metric]:
    states: list[tuple[str, str, Any, Any]] = [
        ("hide_evaluations", "Evaluations by state.", Evaluation.state, EvaluationState),
        ("hide_shards", "Shards by state; pending is the queue.", Shard.state, ShardState),
        ("hide_attempts", "Attempts by state.", Attempt.state, AttemptState),
    ]
    for name, about, column, known in states:
        counted = select(column, func.count()).group_by(column)
        yield _gauge(name, about, _by_state(session, counted, known))
    under_way = select(Evaluation.id).where(Evaluation.state.not_in(ENDED))
    of_them = select(Episode.state, func.count()).where(Episode.evaluation_id.in_(under_way))
    yield _gauge(
        "hide_open_episodes",
        "Episodes by state, of evaluations that have not ended.",
        _by_state(session, of_them.group_by(Episode.state), EpisodeState),
    )
    alarms = session.scalar(select(func.count()).select_from(Divergence)) or 0
    yield _gauge("hide_divergences", "Second, different results.", [({}, alarms)])
    yield _gauge("hide_queue_age_seconds", "Of what waits longest.", [({}, _age(session))])


def _by_state(session: Session, counted: Any, known: Any) -> list[Value]:
    found: dict[str, int] = dict(session.execute(counted).all())
    return [({"state": str(state)}, found.get(state, 0)) for state in known]


def _age(session: Session) -> float:
    """Seconds since the oldest evaluation of which nothing was handed out was asked for."""
    oldest = select(func.min(Evaluation.created)).where(Evaluation.state == EvaluationState.QUEUED)
    since = session.scalar(oldest)
    return max(0.0, (now() - since).total_seconds()) if since else 0.0
