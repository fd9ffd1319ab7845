"""The worker's client against a real server that refuses, breaks and restarts."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.processes import wait_for
from tests.workers.ledger_peer import TOKEN, Kept, Peer, free_port, serving
from workers.ledger_client import (
    Dropped,
    GrowingFile,
    LedgerClient,
    Refused,
    Stale,
    Unreachable,
)


@pytest.fixture
def peer() -> Iterator[Peer]:
    with serving() as peer:
        yield peer


def client(url: str, **settings: object) -> LedgerClient:
    return LedgerClient(url, "a1", str(settings.pop("token", TOKEN)), **settings)  # type: ignore


def test_the_server_hears_of_an_episode(peer: Peer) -> None:
    with client(peer.url) as ledger:
        ledger.start("e1")
        ledger.fault("e1", "no such thing as a cup")

    assert peer.kept.told == [("start", "e1"), ("fault", "e1")]
    assert peer.kept.faults == {"e1": "no such thing as a cup"}


def test_a_failing_server_is_asked_again(peer: Peer) -> None:
    peer.kept.answers["start"] = [500, 503]

    with client(peer.url) as ledger:
        ledger.start("e1")

    assert peer.kept.told == [("start", "e1")] * 3


def test_a_checkpoint_is_fetched_and_asked_for_again(peer: Peer, tmp_path: Path) -> None:
    peer.kept.checkpoint = b"weights" * 100_000
    peer.kept.answers["checkpoint"] = [500]

    with client(peer.url) as ledger:
        ledger.fetch_checkpoint(tmp_path / "a")

    assert (tmp_path / "a").read_bytes() == peer.kept.checkpoint
    assert peer.kept.told == [("checkpoint", "a1")] * 2


def test_a_checkpoint_of_a_stale_attempt_is_refused(peer: Peer, tmp_path: Path) -> None:
    peer.kept.answers["checkpoint"] = [409]

    with client(peer.url) as ledger, pytest.raises(Stale, match="as the test wants it"):
        ledger.fetch_checkpoint(tmp_path / "a")


def test_a_stale_attempt_is_told_so(peer: Peer) -> None:
    peer.kept.answers["start"] = [409]

    with client(peer.url) as ledger, pytest.raises(Stale, match="as the test wants it"):
        ledger.start("e1")


@pytest.mark.parametrize("code", [401, 403, 404, 422])
def test_a_refusal_carries_the_servers_words(peer: Peer, code: int) -> None:
    peer.kept.answers["start"] = [code]

    with client(peer.url) as ledger, pytest.raises(Refused, match=f"gave {code}: .*start {code}"):
        ledger.start("e1")
    assert len(peer.kept.told) == 1


def test_a_wrong_token_is_refused(peer: Peer) -> None:
    with client(peer.url, token="guessed") as ledger, pytest.raises(Refused, match="no current"):
        ledger.start("e1")


def test_a_server_that_is_not_there_is_given_up() -> None:
    nowhere = f"http://127.0.0.1:{free_port()}"

    with client(nowhere, retry_for=0.5) as ledger, pytest.raises(Unreachable, match=r"for 0.5 s"):
        ledger.start("e1")


def test_no_proxy_stands_between(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{free_port()}")
    monkeypatch.setenv("ALL_PROXY", f"http://127.0.0.1:{free_port()}")

    with client(peer.url, retry_for=0.5) as ledger:
        ledger.start("e1")

    assert peer.kept.told == [("start", "e1")]


def test_a_growing_file_is_followed_to_its_end(peer: Peer, tmp_path: Path) -> None:
    growing, path = tmp_path / "one.rrd.1234.part", tmp_path / "one.rrd"
    file = GrowingFile(path)

    with client(peer.url) as ledger, ThreadPoolExecutor() as threads:
        upload = threads.submit(ledger.upload_recording, "e1", file)
        with growing.open("wb") as output:
            for number in range(3):
                output.write(bytes([number]) * 1000)
                output.flush()
                arrived = 1000 * (number + 1)
                wait_for(lambda total=arrived: sum(peer.kept.pieces) >= total, "the piece", 5)
            output.write(b"end")
        growing.rename(path)
        file.finish()
        stored = upload.result(5)

    assert peer.kept.recordings["e1"] == path.read_bytes()
    assert stored.size == 3003


def test_a_file_that_was_finished_before_is_sent(peer: Peer, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    path.write_bytes(b"x" * 10**6)
    file = GrowingFile(path)
    file.finish()

    with client(peer.url) as ledger:
        assert ledger.upload_recording("e1", file).size == 10**6


def test_a_file_that_never_came_is_missed(peer: Peer, tmp_path: Path) -> None:
    file = GrowingFile(tmp_path / "one.rrd")
    file.finish()

    with client(peer.url) as ledger, pytest.raises(FileNotFoundError, match=r"one\.rrd"):
        ledger.upload_recording("e1", file)


def test_a_dropped_file_ends_its_upload_and_is_not_kept(peer: Peer, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    path.write_bytes(b"x")
    file = GrowingFile(path)

    with client(peer.url) as ledger, ThreadPoolExecutor() as threads:
        upload = threads.submit(ledger.upload_recording, "e1", file)
        wait_for(lambda: peer.kept.pieces, "the first piece")
        file.drop()

        with pytest.raises(Dropped):
            upload.result(5)
    assert peer.kept.recordings == {}


def test_an_upload_that_the_server_interrupts_is_sent_anew(peer: Peer, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    path.write_bytes(bytes(range(256)) * 10**4)
    file = GrowingFile(path)
    file.finish()
    peer.kept.answers["recording"] = [500, 503]

    with client(peer.url) as ledger:
        ledger.upload_recording("e1", file)

    assert peer.kept.told == [("recording", "e1")] * 3
    assert peer.kept.recordings["e1"] == path.read_bytes()


def test_an_upload_survives_a_restart_of_the_server(tmp_path: Path) -> None:
    path, port, before, after = tmp_path / "one.rrd", free_port(), Kept(), Kept()
    path.write_bytes(b"first")
    file = GrowingFile(path)

    with ExitStack() as stack, ThreadPoolExecutor() as threads:
        ledger = stack.enter_context(client(f"http://127.0.0.1:{port}"))
        with serving(before, port):
            upload = threads.submit(ledger.upload_recording, "e1", file)
            wait_for(lambda: before.pieces, "the first piece")
        stack.enter_context(serving(after, port))
        with path.open("ab") as output:
            output.write(b", second")
        file.finish()
        upload.result(15)

    assert (before.recordings, after.recordings) == ({}, {"e1": b"first, second"})


def test_an_upload_of_a_stale_attempt_ends_before_its_file(peer: Peer, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    path.write_bytes(b"x")
    peer.kept.answers["recording"] = [409]

    with client(peer.url) as ledger, pytest.raises(Stale):
        ledger.upload_recording("e1", GrowingFile(path))
