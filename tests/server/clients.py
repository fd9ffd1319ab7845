"""Clients of the whole application for tests; its server has no workers and hands nothing out."""

import socket
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI

from server import lifecycle
from server.app import create_app
from server.hub import Hub
from server.models import Attempt, Episode
from server.settings import Settings
from tests.server import ledgers
from workers.protocol import INTERNAL, EpisodeCommit

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette would rather have another HTTP library
    from fastapi.testclient import TestClient

API = "/api/v1"
PROBLEM = "application/problem+json"
SMALL = {"policy": "expert", "tasks": ["search_drawer"], "episodes": 2}


def application(data: Path, **settings: Any) -> FastAPI:
    """The API over a new ledger, without the trained policies that come along."""
    ledgers.laid(data)
    quiet = {"workers": 0, "references": False, "smoke": False, "trained": data / "no-trained"}
    return create_app(Settings(data=data, **{**quiet, **settings}))


@contextmanager
def client(data: Path, **settings: Any) -> Iterator[TestClient]:
    """A client that calls the application directly; an exception of the server is raised here."""
    app = application(data, **settings)
    with TestClient(app, base_url="http://127.0.0.1") as found:
        yield found


def hub_of(client: TestClient) -> Hub:
    """What the application behind a client holds."""
    hub: Hub = client.app.state.hub
    return hub


@contextmanager
def served(data: Path, **settings: Any) -> Iterator[tuple[Hub, httpx.Client]]:
    """The application on a port of its own, for what is sent or received piece by piece."""
    app = application(data, **settings)
    config = uvicorn.Config(app, log_config=None, timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            while not server.started:
                assert thread.is_alive(), "the server did not start"
                time.sleep(0.01)
            address = f"http://127.0.0.1:{listening.getsockname()[1]}"
            with httpx.Client(base_url=address, trust_env=False, timeout=20) as found:
                yield app.state.hub, found
        finally:
            app.state.hub.bell.close()
            server.should_exit = True
            thread.join(timeout=20)


class Worker:
    """Holds the next shard, and reports over HTTP as a worker does."""

    def __init__(self, hub: Hub, client: httpx.Client):
        self.client = client
        with hub.database.writing() as session:
            shard = lifecycle.next_shard(session)
            assert shard is not None
            attempt, token = lifecycle.lease(session, shard, engine="local")
            self.attempt, self.shard = attempt.id, shard.id
            self.evaluation = shard.evaluation_id
            self.specs = {one.id: lifecycle.spec_of(one) for one in shard.episodes}
        self.episodes = list(self.specs)
        self.headers = {"Authorization": f"Bearer {token}"}

    def path(self, episode: str, what: str) -> str:
        """Where something of an episode is reported."""
        return f"{INTERNAL}/attempts/{self.attempt}/episodes/{episode}/{what}"

    def start(self, episode: str) -> httpx.Response:
        return self.client.post(self.path(episode, "start"), headers=self.headers)

    def record(self, episode: str, content: Any) -> httpx.Response:
        return self.client.put(
            self.path(episode, "recording"), content=content, headers=self.headers
        )

    def finish(self, episode: str, what: EpisodeCommit | None = None) -> httpx.Response:
        what = what or ledgers.result_of(self.specs[episode])
        headers = self.headers | {"Content-Type": "application/json"}
        path = self.path(episode, "result")
        return self.client.put(path, content=what.model_dump_json(), headers=headers)

    def fault(self, episode: str, reason: str = "no room") -> httpx.Response:
        path = self.path(episode, "fault")
        return self.client.post(path, json={"reason": reason}, headers=self.headers)


def state_of(hub: Hub, episode: str) -> str:
    """Where an episode stands in the ledger."""
    with hub.database.reading() as session:
        return session.get_one(Episode, episode).state


def create(client: httpx.Client, **wanted: Any) -> dict[str, Any]:
    """A small evaluation that was asked for."""
    answer = client.post(f"{API}/evaluations", json=SMALL | wanted)
    assert answer.status_code == 202, answer.text
    document: dict[str, Any] = answer.json()
    return document


def ended(hub: Hub, worker: Worker, reason: str | None) -> None:
    """The engine says that an attempt is over."""
    with hub.database.writing() as session:
        lifecycle.end_attempt(session, session.get_one(Attempt, worker.attempt), reason)


def problem_of(answer: httpx.Response) -> dict[str, Any]:
    """The problem that is answered; every one has the same members."""
    assert answer.headers["content-type"] == PROBLEM, answer.text
    document: dict[str, Any] = answer.json()
    assert document["status"] == answer.status_code
    assert document["detail"] and document["title"] and document["code"]
    return document
