"""Backups of a server that goes on, and folders that are made of them."""

import json
import os
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, select

from server import backup as backups
from server.backup import BackupError, back_up, restore
from server.blobs import RRD, Blobs, note
from server.data_folder import DataFolder
from server.db import Database
from server.models import Episode, Evaluation, Removal
from server.read_only import ReadOnlyFolder
from server.states import EpisodeState
from server.verification.ledger import Verifier
from tests.server import ledgers, tampering

TASKS = ["push_button_times", "search_drawer"]


class Server:
    """A data folder that is held and written, as a running server does."""

    def __init__(self, path: Path):
        self.path, self.closed = path, False
        ledgers.laid(path)
        self.held = DataFolder(path)
        self.database, self.store = Database(self.held.ledger), Blobs(self.held.blobs)

    def ask(self, episodes: int = 25) -> None:
        with self.database.writing() as session:
            ledgers.created(session, tasks=TASKS, episodes=episodes)

    def play(self) -> bool:
        """One shard, with a file for each episode that no other has."""
        with self.database.writing() as session:
            found = ledgers.leased(session)
            if found is None:
                return False
            attempt, shard = found
            session.flush()
            for episode in shard.episodes:
                sha256 = self.store.put(os.urandom(2000))
                note(session, sha256, 2000, RRD)
                ledgers.lifecycle.begin(session, attempt, episode)
                told = ledgers.result_of(ledgers.lifecycle.spec_of(episode))
                told = told.model_copy(update={"recording": sha256})
                ledgers.commit(session, self.store, attempt, episode, told)
            ledgers.lifecycle.end_attempt(session, attempt, None)
        return True

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            self.database.close()
            self.held.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    running = Server(tmp_path / "data")
    yield running
    running.close()


def copied(data: Path, target: Path) -> backups.Copied:
    with ReadOnlyFolder.opened(data) as folder:
        return back_up(folder, target)


def final(folder: Path) -> dict[str, str]:
    """Digests of the final episodes, by id."""
    with closing(Database(folder / "ledger.sqlite3")) as database, database.reading() as session:
        wanted = select(Episode.id, Episode.digest).where(Episode.state == EpisodeState.FINAL)
        return {id: str(digest) for id, digest in session.execute(wanted)}


def require_sound(folder: Path) -> None:
    """Every digest, verdict, span and named file but what cannot be a recording's content."""
    with ReadOnlyFolder.opened(folder) as opened:
        found = Verifier(opened, sample=0).verify()
    assert all("recording" in one.what for one in found.mismatches)  # random bytes are none
    assert found.files == 2 * found.episodes


def test_backups_of_a_server_that_commits_meanwhile_are_whole(
    server: Server, tmp_path: Path
) -> None:
    server.ask()
    stop = threading.Event()

    def go_on() -> None:
        while not stop.is_set() and server.play():
            pass

    playing = threading.Thread(target=go_on)
    playing.start()
    try:
        made = [copied(server.path, tmp_path / f"backup-{n}") for n in range(4)]
    finally:
        stop.set()
        playing.join()
    while server.play():
        pass

    assert all(not one.faults for one in made)
    whole = final(server.path)
    before: set[str] = set()
    for n in range(4):
        restore(tmp_path / f"backup-{n}", tmp_path / f"restored-{n}")
        require_sound(tmp_path / f"restored-{n}")
        there = final(tmp_path / f"restored-{n}")
        assert there.items() <= whole.items()
        assert before <= set(there)
        before = set(there)
    assert len(whole) == 50


def test_a_restored_server_takes_up_what_was_handed_out(server: Server, tmp_path: Path) -> None:
    server.ask(episodes=5)
    server.play()
    with server.database.writing() as session:
        assert ledgers.leased(session) is not None  # and nobody ends it
    copied(server.path, tmp_path / "backup")

    restore(tmp_path / "backup", tmp_path / "restored")

    other = Server(tmp_path / "restored")
    with other.database.writing() as session:
        sources = ledgers.evaluations.current_sources()
        assert ledgers.lifecycle.recover(session, sources) == 1
    while other.play():
        pass
    with other.database.reading() as session:
        assert session.scalars(select(Evaluation.state)).all() == ["completed"]
        assert session.scalar(select(func.count()).where(Episode.success)) == 10
    other.close()


def test_a_backup_is_brought_up_to_date(server: Server, tmp_path: Path) -> None:
    server.ask(episodes=10)
    server.play()
    first = copied(server.path, tmp_path / "backup")
    [old, *_] = (tmp_path / "backup" / "blobs").glob("*/*")
    before = old.stat().st_mtime_ns
    server.play()

    second = copied(server.path, tmp_path / "backup")

    assert (first.files, second.files) == (6, 11)  # 5 recordings a shard, and one thumbnail
    assert old.stat().st_mtime_ns == before
    restore(tmp_path / "backup", tmp_path / "restored")
    assert len(final(tmp_path / "restored")) == 10


def test_a_damaged_and_a_lost_file_are_named_and_the_rest_is_kept(
    server: Server, tmp_path: Path
) -> None:
    server.ask(episodes=5)
    server.play()
    hashes = [row[0] for row in tampering.ask(server.path, "SELECT sha256 FROM blobs ORDER BY 1")]
    tampering.edit_blob(server.path, hashes[0])
    server.store.path(hashes[1]).unlink()

    made = copied(server.path, tmp_path / "backup")
    back = restore(tmp_path / "backup", tmp_path / "restored")

    assert [fault.partition(":")[0] for fault in made.faults] == hashes[:2]
    assert "is damaged" in made.faults[0] and "is gone" in made.faults[1]
    assert (made.files, back.files) == (4, 4)
    assert len(final(tmp_path / "restored")) == 5


def test_a_file_that_was_removed_to_make_room_is_not_missed(server: Server, tmp_path: Path) -> None:
    server.ask(episodes=5)
    server.play()
    with server.database.writing() as session:
        [sha256, *_] = session.scalars(select(Episode.recording)).all()
        session.add(Removal(sha256=sha256, reason="test"))
    server.store.path(str(sha256)).unlink()

    assert copied(server.path, tmp_path / "backup").faults == []


def test_a_stopped_server_is_copied_and_left_as_it_was(server: Server, tmp_path: Path) -> None:
    server.ask(episodes=5)
    server.play()
    server.close()
    before = tampering.everything(server.path)

    copied(server.path, tmp_path / "backup")

    after = tampering.everything(server.path)
    assert after.pop(".files.lock") == b""
    assert after == before


def test_a_backup_whose_ledger_was_changed_is_refused(server: Server, tmp_path: Path) -> None:
    copied(server.path, tmp_path / "backup")
    with (tmp_path / "backup" / "ledger.sqlite3").open("ab") as ledger:
        ledger.write(b"more")

    with pytest.raises(BackupError, match="not whole"):
        restore(tmp_path / "backup", tmp_path / "restored")

    assert not (tmp_path / "restored").exists()


def test_a_backup_that_broke_off_is_refused(server: Server, tmp_path: Path) -> None:
    copied(server.path, tmp_path / "backup")
    (tmp_path / "backup" / "backup.json").unlink()  # it is written last

    with pytest.raises(BackupError, match="is no backup"):
        restore(tmp_path / "backup", tmp_path / "restored")


def test_a_restoration_that_broke_off_is_gone_on_with(server: Server, tmp_path: Path) -> None:
    server.ask(episodes=5)
    server.play()
    copied(server.path, tmp_path / "backup")
    broken = tmp_path / "restored"
    (broken / "blobs").mkdir(parents=True)
    (broken / ".ledger.sqlite3.part").write_bytes(b"half")

    restore(tmp_path / "backup", broken)

    assert len(final(broken)) == 5


def test_a_newer_format_is_refused(server: Server, tmp_path: Path) -> None:
    copied(server.path, tmp_path / "backup")
    manifest = tmp_path / "backup" / "backup.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"format": 2}))

    with pytest.raises(BackupError, match="newer version"):
        restore(tmp_path / "backup", tmp_path / "restored")


def test_folders_with_something_else_are_left_alone(server: Server, tmp_path: Path) -> None:
    letters = tmp_path / "letters"
    letters.mkdir()
    (letters / "thesis.tex").write_text("chapter one")
    copied(server.path, tmp_path / "backup")

    with pytest.raises(BackupError, match=r"something else \(thesis.tex\)"):
        copied(server.path, letters)
    with pytest.raises(BackupError, match="holds something"):
        restore(tmp_path / "backup", letters)
    with pytest.raises(BackupError, match="holds something"):
        restore(tmp_path / "backup", server.path)
    with pytest.raises(BackupError, match="within the data folder"):
        copied(server.path, server.path / "blobs")
    with pytest.raises(BackupError, match="is no backup"):
        restore(letters, tmp_path / "restored")

    assert tampering.everything(letters) == {"thesis.tex": b"chapter one"}
