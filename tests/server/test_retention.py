"""Recordings go to make room; results never do, and what went is said to be gone."""

import os
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import select

from server import retention
from server.blobs import RRD, note
from server.keeping import files_stay
from server.models import Blob, Episode, now
from server.retention import Retention, Rule
from tests.server import ledgers, tampering
from tests.server.clients import API, TestClient, Worker, create, hub_of, problem_of
from tests.server.people import LOOPBACK, application
from tests.server.test_backup import Server
from tests.server.verification.test_ledger import verified

SIZE = 2000  # bytes of each recording
RECORDING = b"RRF2, as a recording begins"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    """Five final episodes; each recording is ten days older than the next one's."""
    running = Server(tmp_path / "data")
    running.ask(episodes=5)
    running.play()
    date_recordings(running)
    yield running
    running.close()


def date_recordings(server: Server) -> None:
    """Dates the recordings; a blob's row is immutable, so its triggers go first."""
    with server.database.reading() as session:
        hashes = list(session.scalars(select(Blob.sha256).where(Blob.media_type == RRD)))
    dates = [now() - timedelta(days=10 * n, hours=1) for n in range(len(hashes))]
    tampering.alter(
        server.path,
        *(
            f"UPDATE blobs SET created = '{date:%Y-%m-%d %H:%M:%S.%f}' WHERE sha256 = '{sha256}'"
            for sha256, date in zip(hashes, dates, strict=True)
        ),
    )


def there(server: Server) -> int:
    """Recordings whose files are here."""
    with server.database.reading() as session:
        hashes = session.scalars(select(Episode.recording).where(Episode.recording.is_not(None)))
        return sum(server.store.holds(str(one)) for one in hashes)


@pytest.mark.parametrize(
    ("rule", "gone"),
    [
        (Rule(), 0),
        (Rule(days=100), 0),
        (Rule(days=25), 2),
        (Rule(most=5 * SIZE), 0),
        (Rule(most=4 * SIZE), 1),
        (Rule(most=2 * SIZE + 1), 3),
        (Rule(days=25, most=2 * SIZE), 3),
        (Rule(most=0), 5),
    ],
)
def test_old_and_large_go_first(server: Server, rule: Rule, gone: int) -> None:
    found = retention.prune(server.database, server.store, rule)

    assert (len(found), there(server)) == (gone, 5 - gone)
    with server.database.reading() as session:
        assert retention.kept(session) == (5 - gone, (5 - gone) * SIZE)
        assert retention.doomed(session, rule) == []


def test_nothing_that_was_measured_goes(server: Server) -> None:
    query = "SELECT id, digest, recording, thumbnail, success FROM episodes WHERE state = 'final'"
    before = tampering.ask(server.path, query)

    retention.prune(server.database, server.store, Rule(most=0))

    assert tampering.ask(server.path, query) == before
    found = verified(server.path)
    assert found.mismatches == []
    assert found.removed == 5


def test_a_recording_that_comes_again_is_there_again(server: Server) -> None:
    with server.database.reading() as session:
        sha256 = str(session.scalars(select(Episode.recording)).first())
    content = server.store.path(sha256).read_bytes()
    retention.prune(server.database, server.store, Rule(most=0))

    server.store.put(content)
    with server.database.writing() as session:
        note(session, sha256, len(content), RRD)

    with server.database.reading() as session:
        assert retention.kept(session) == (1, SIZE)


def test_orphans_are_listed_once_they_are_a_day_old(server: Server) -> None:
    new, old = server.store.put(b"of an attempt under way"), server.store.put(b"of a lost one")
    yesterday = time.time() - 90000
    os.utime(server.store.path(old), (yesterday, yesterday))

    with server.database.reading() as session:
        found = retention.orphans(session, server.store)
    removed = retention.prune_orphans(server.database, server.store)

    assert [one.path for one in found] == [server.store.path(old)]
    assert removed == found
    assert (server.store.holds(new), server.store.holds(old)) == (True, False)
    assert there(server) == 5


def test_a_file_left_over_by_a_crash_between_row_and_file_is_an_orphan(server: Server) -> None:
    [doomed] = retention.prune(server.database, server.store, Rule(days=35))
    server.store.path(doomed.sha256).write_bytes(b"still here")
    later = now() + timedelta(days=2)

    with server.database.reading() as session:
        found = retention.orphans(session, server.store, later)

    assert [one.path for one in found] == [server.store.path(doomed.sha256)]


def test_a_running_server_prunes_by_itself(server: Server) -> None:
    keeper = Retention(server.database, server.store, Rule(days=25))

    keeper.start()
    deadline = time.monotonic() + 20
    while there(server) != 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    keeper.stop()

    assert there(server) == 3


def test_nothing_goes_while_a_backup_is_made(server: Server) -> None:
    keeper = Retention(server.database, server.store, Rule(most=0))

    with files_stay(server.path):
        keeper.start()
        time.sleep(0.2)
        assert there(server) == 5
    deadline = time.monotonic() + 20
    while there(server) and time.monotonic() < deadline:
        time.sleep(0.01)
    keeper.stop()

    assert there(server) == 0


def test_the_api_says_that_it_was_removed(here: TestClient) -> None:
    hub = hub_of(here)
    episode = _recorded(here)
    assert here.get(f"{API}/episodes/{episode}/recording.rrd").content == RECORDING

    retention.prune(hub.database, hub.blobs, Rule(most=0))

    document = here.get(f"{API}/episodes/{episode}").json()
    answer = here.get(f"{API}/episodes/{episode}/recording.rrd")
    assert (document["recording"], document["success"]) == (None, True)
    assert document["recording_removed"] is not None
    assert answer.status_code == 410
    assert problem_of(answer)["code"] == "recording_removed"
    listed = here.get(f"{API}/episodes", params={"limit": 200}).json()["items"]
    assert sum(one["recording_removed"] is not None for one in listed) == 1


def _recorded(client: TestClient) -> str:
    """An episode that a worker recorded; its id."""
    create(client)
    worker = Worker(hub_of(client), client)
    [episode, *_] = worker.episodes
    worker.start(episode)
    stored = worker.record(episode, RECORDING).json()
    told = ledgers.result_of(worker.specs[episode])
    answer = worker.finish(episode, told.model_copy(update={"recording": stored["sha256"]}))
    assert answer.status_code == 200, answer.text
    return episode


def test_the_page_says_that_it_was_removed(tmp_path: Path) -> None:
    with TestClient(application(tmp_path), base_url=LOOPBACK) as people:
        hub, episode = hub_of(people), _recorded(people)
        before = people.get(f"/episodes/{episode}").text

        retention.prune(hub.database, hub.blobs, Rule(most=0))

        after = people.get(f"/episodes/{episode}").text
    assert 'id="viewer"' in before and "was removed" not in before
    assert 'id="viewer"' not in after
    assert f"The recording was removed on {now():%Y-%m-%d} to make room" in after
