"""What workers report over HTTP, and who may watch it meanwhile."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from sqlalchemy import func, select

from hide_tasks.contract import Failure
from server import growing
from server.models import Divergence
from server.routes import episodes as episode_routes
from tests.server import ledgers
from tests.server.clients import (
    API,
    TestClient,
    Worker,
    client,
    create,
    ended,
    hub_of,
    problem_of,
    served,
    state_of,
)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A server for tests that only ask for one more shard, whichever that is."""
    with client(tmp_path_factory.mktemp("shared")) as found:
        yield found


def test_a_shard_is_played_over_http(here: TestClient) -> None:
    id = create(here)["id"]
    worker = Worker(hub_of(here), here)

    for number, episode in enumerate(worker.episodes):
        assert worker.start(episode).status_code == 204
        detail = here.get(f"{API}/episodes/{episode}").json()
        assert (detail["state"], detail["live"]) == ("running", True)
        stored = worker.record(episode, f"RRF2 {number}".encode()).json()
        what = ledgers.result_of(worker.specs[episode], Failure.OVERCOUNT if number else None)
        sent = what.model_copy(update={"recording": stored["sha256"]})
        assert worker.finish(episode, sent).json() == {"already": False}
        assert worker.finish(episode, sent).json() == {"already": True}
        detail = here.get(f"{API}/episodes/{episode}").json()
        assert (detail["state"], detail["live"]) == ("final", False)
        recording = here.get(detail["recording"])
        assert recording.content == f"RRF2 {number}".encode()
        assert recording.headers["content-type"] == "application/vnd.rerun.rrd"
        assert "immutable" in recording.headers["cache-control"]
        thumbnail = here.get(detail["thumbnail"])
        assert thumbnail.content == what.thumbnail
        assert thumbnail.headers["content-type"] == "image/jpeg"
    ended(hub_of(here), worker, None)

    evaluation = here.get(f"{API}/evaluations/{id}").json()
    assert evaluation["state"] == "completed"
    assert evaluation["verdicts"]["success"]["successes"] == 2
    assert evaluation["verdicts"]["exact"]["successes"] == 1
    groups = here.get(f"{API}/evaluations/{id}/failures").json()
    assert [(one["failure"], one["episodes"]) for one in groups] == [("overcount", 1)]


def test_recordings_are_served_in_ranges(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    sha256 = worker.record(episode, b"0123456789").json()["sha256"]
    what = ledgers.result_of(worker.specs[episode])
    worker.finish(episode, what.model_copy(update={"recording": sha256}))

    def part(wanted: str) -> httpx.Response:
        return here.get(f"{API}/episodes/{episode}/recording.rrd", headers={"Range": wanted})

    assert (part("bytes=2-4").status_code, part("bytes=2-4").content) == (206, b"234")
    refused = part("bytes=10-")
    assert (refused.status_code, refused.headers["content-range"]) == (416, "bytes */10")
    assert "10 bytes" in problem_of(refused)["detail"]
    for malformed in ("rows=2-4", "bytes", "bytes=4-2"):
        assert problem_of(part(malformed))["code"] == "malformed_range"


def test_episodes_without_files_have_none(here: TestClient) -> None:
    create(here, recordings=False)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)

    detail = here.get(f"{API}/episodes/{episode}").json()
    assert (detail["recording"], detail["thumbnail"], detail["live"]) == (None, None, False)
    for file in ("recording.rrd", "thumbnail.jpg"):
        assert here.get(f"{API}/episodes/{episode}/{file}").status_code == 404


def test_a_running_episode_without_a_recording_is_not_waited_for_long(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(episode_routes, "PATIENCE", 0.2)
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])

    answer = here.get(f"{API}/episodes/{worker.episodes[0]}/recording.rrd")

    assert answer.status_code == 404


def test_a_recording_is_watched_while_it_grows(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        create(here)
        worker = Worker(hub, here)
        episode = worker.episodes[0]
        worker.start(episode)
        seen: list[bytes] = []
        first, second = threading.Event(), threading.Event()

        def watch() -> None:
            with here.stream("GET", f"{API}/episodes/{episode}/recording.rrd") as answer:
                for piece in answer.iter_raw():
                    seen.append(piece)
                    first.set()
                    if b"more" in b"".join(seen):
                        second.set()

        def pieces() -> Iterator[bytes]:
            yield b"RRF2 "
            assert first.wait(10), "the first piece did not arrive while the recording grew"
            yield b"and more"
            assert second.wait(10)

        thread = threading.Thread(target=watch)
        thread.start()
        stored = worker.record(episode, pieces())
        thread.join(timeout=10)

        assert stored.status_code == 200
        assert b"".join(seen) == b"RRF2 and more"
        late = here.get(f"{API}/episodes/{episode}/recording.rrd")  # there, but not final yet
        assert (late.status_code, late.content) == (200, b"RRF2 and more")
        assert late.headers["cache-control"] == "no-store"
        assert list(hub.folder.growing.iterdir()) == []


def test_too_large_a_recording_over_http(here: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growing, "MOST", 10)
    create(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])

    answer = worker.record(worker.episodes[0], b"x" * 11)

    assert answer.status_code == 413 and problem_of(answer)["code"] == "too_large"
    assert list(hub_of(here).folder.growing.iterdir()) == []


def test_a_recording_whose_attempt_ends_meanwhile_is_stale(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        create(here)
        worker = Worker(hub, here)
        episode = worker.episodes[0]
        worker.start(episode)

        def pieces() -> Iterator[bytes]:
            yield b"RRF2"
            while not (found := hub.recordings.get(episode)) or not found.size:
                time.sleep(0.01)
            ended(hub, worker, "it hung")
            hub.recordings.forget(episode)
            yield b" and more"

        answer = worker.record(episode, pieces())

        assert answer.status_code == 409 and problem_of(answer)["code"] == "stale_attempt"
        assert list(hub.folder.growing.iterdir()) == []


def test_a_fault_puts_an_episode_back(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    worker.record(episode, b"RRF2")

    assert worker.fault(episode).status_code == 204
    assert state_of(hub_of(here), episode) == "pending"
    assert hub_of(here).recordings.get(episode) is None
    assert worker.fault(episode, "x" * 2001).status_code == 422


def test_two_results_of_an_episode_are_an_alarm(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    episode = worker.episodes[0]
    worker.start(episode)
    worker.finish(episode)

    other = ledgers.result_of(worker.specs[episode], Failure.OVERCOUNT)
    answer = worker.finish(episode, other)

    assert answer.status_code == 409 and problem_of(answer)["code"] == "diverged"
    assert here.get(f"{API}/episodes/{episode}").json()["exact"] is True
    with hub_of(here).database.reading() as session:
        assert session.scalar(select(func.count()).select_from(Divergence)) == 1


REPORTS = ["start", "recording", "result", "fault"]


def report(worker: Worker, what: str, episode: str) -> httpx.Response:
    if what == "start":
        return worker.start(episode)
    if what == "recording":
        return worker.record(episode, b"RRF2")
    if what == "result":
        return worker.finish(episode, ledgers.result_of(worker.specs[worker.episodes[0]]))
    return worker.fault(episode)


@pytest.mark.parametrize("what", REPORTS)
@pytest.mark.parametrize(
    "header", ["", "Bearer", "Bearer ", "Bearer wrong", "Basic dXNlcjpwdw==", "bearer é"]
)
def test_a_report_needs_its_attempts_token(shared: TestClient, what: str, header: str) -> None:
    create(shared)
    worker = Worker(hub_of(shared), shared)
    worker.headers = {"Authorization": header.encode("latin-1")} if header else {}

    answer = report(worker, what, worker.episodes[0])

    assert answer.status_code == 401
    assert problem_of(answer)["code"] in ("no_token", "wrong_token")
    assert state_of(hub_of(shared), worker.episodes[0]) == "pending"


@pytest.mark.parametrize("what", REPORTS)
def test_another_attempts_token_opens_nothing(shared: TestClient, what: str) -> None:
    create(shared, episodes=10)
    worker, other = (Worker(hub_of(shared), shared) for _ in range(2))
    worker.headers = other.headers

    assert report(worker, what, worker.episodes[0]).status_code == 401


@pytest.mark.parametrize("what", REPORTS)
def test_an_attempt_reports_only_its_own_episodes(shared: TestClient, what: str) -> None:
    create(shared, episodes=10)
    worker, other = (Worker(hub_of(shared), shared) for _ in range(2))
    worker.start(worker.episodes[0])

    assert report(worker, what, other.episodes[0]).status_code == 404
    assert report(worker, what, "ep_x").status_code == 404


@pytest.mark.parametrize("what", REPORTS)
def test_an_ended_attempt_is_stale(shared: TestClient, what: str) -> None:
    create(shared)
    worker = Worker(hub_of(shared), shared)
    worker.start(worker.episodes[0])
    ended(hub_of(shared), worker, "it hung")

    answer = report(worker, what, worker.episodes[0])

    assert answer.status_code == 409 and problem_of(answer)["code"] == "stale_attempt"


@pytest.mark.parametrize("what", ["recording", "result"])
def test_what_was_not_begun_is_not_reported(shared: TestClient, what: str) -> None:
    create(shared)
    worker = Worker(hub_of(shared), shared)

    assert report(worker, what, worker.episodes[0]).status_code == 409


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b'{"digest": 1}', b'{"fast": 1}'])
def test_a_report_that_is_none_is_refused(shared: TestClient, content: bytes) -> None:
    create(shared)
    worker = Worker(hub_of(shared), shared)
    worker.start(worker.episodes[0])
    path = worker.path(worker.episodes[0], "result")
    headers = worker.headers | {"Content-Type": "application/json"}

    answer = shared.put(path, content=content, headers=headers)

    assert answer.status_code == 422
    assert problem_of(answer)["errors"]
    assert state_of(hub_of(shared), worker.episodes[0]) == "running"
