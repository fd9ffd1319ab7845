"""A clock that jumps: what is measured, and who may report it, does not hang on it."""

import socket
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from sqlalchemy import select

from server import models
from server.app import create_app
from server.hub import Hub
from server.models import Attempt, Episode, new_id, now, read_clock
from server.settings import Settings
from tests.server import ledgers
from tests.server.running import until

WANTED = {"policy": "noop", "tasks": ["push_button_times"], "episodes": 2}
YEARS = timedelta(days=3650)


@pytest.fixture
def playing(tmp_path: Path) -> Iterator[tuple[Hub, httpx.Client]]:
    """A server with a worker, in this process, where its clock can be set."""
    ledgers.laid(tmp_path / "data")
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        port = listening.getsockname()[1]
        app = create_app(Settings(data=tmp_path / "data", workers=1, references=False, port=port))
        server = uvicorn.Server(uvicorn.Config(app, log_config=None, timeout_graceful_shutdown=1))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            until(lambda: server.started, "the server")
            address = f"http://127.0.0.1:{port}/api/v1"
            with httpx.Client(base_url=address, trust_env=False, timeout=60) as client:
                yield app.state.hub, client
        finally:
            app.state.hub.bell.close()
            server.should_exit = True
            thread.join(timeout=60)


@pytest.fixture(autouse=True)
def _clock_is_right_again() -> Iterator[None]:
    yield
    models.clock = read_clock


def set_clock(ahead: timedelta) -> None:
    """From now on the server's clock is so far from this machine's."""
    models.clock = lambda: read_clock() + ahead


def digests(hub: Hub, evaluation: str) -> dict[int, Any]:
    with hub.database.reading() as session:
        found = select(Episode.index, Episode.digest).filter_by(evaluation_id=evaluation)
        return dict(session.execute(found).all())


def test_a_clock_that_jumps_in_mid_episode_changes_nothing(
    playing: tuple[Hub, httpx.Client],
) -> None:
    hub, client = playing

    def ask() -> str:
        return str(client.post("/evaluations", json=WANTED).raise_for_status().json()["id"])

    def look(evaluation: str) -> dict[str, Any]:
        return dict(client.get(f"/evaluations/{evaluation}").raise_for_status().json())

    def begun(evaluation: str, episodes: int) -> bool:
        progress = look(evaluation)["progress"]
        return bool(progress["final"] + progress["running"] >= episodes)

    quiet, jumped = ask(), ask()
    until(lambda: look(quiet)["ended"], "the end", 240)
    until(lambda: begun(jumped, 1), "an episode", 240)
    set_clock(YEARS)
    until(lambda: begun(jumped, 2), "an episode", 240)
    set_clock(-YEARS)
    done = until(lambda: (found := look(jumped))["ended"] and found, "the end", 240)

    assert done["state"] == "completed"
    assert digests(hub, jumped) == digests(hub, quiet)
    with hub.database.reading() as session:
        assert {one.state for one in session.scalars(select(Attempt))} == {"done"}


def test_identifiers_never_go_back() -> None:
    first = new_id("x")
    set_clock(-YEARS)
    then = [new_id("x") for _ in range(3)]
    set_clock(timedelta())
    time.sleep(0.002)

    made = [first, *then, new_id("x")]

    assert made == sorted(made)
    assert abs(now() - datetime.now(UTC)) < timedelta(minutes=1)
