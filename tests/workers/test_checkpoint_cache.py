"""Checkpoints that a worker keeps: fetched once, whole, and left to whoever plays them."""

import hashlib
import os
import threading
import time
from pathlib import Path

import pytest

from workers.checkpoint_cache import FOLDER, WrongContent, default_folder, held, make_room


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Server:
    """Gives its content, and counts how often."""

    def __init__(self, content: bytes, seconds: float = 0.0):
        self.content, self.seconds, self.asked = content, seconds, 0

    def fetch(self, path: Path) -> None:
        self.asked += 1
        time.sleep(self.seconds)
        path.write_bytes(self.content)


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if not path.name.endswith(".lock")}


def kept(folder: Path, content: bytes, age: float = 0.0) -> Path:
    with held(sha256(content), Server(content).fetch, folder) as path:
        pass
    os.utime(path, (time.time() - age,) * 2)
    return path


def test_a_checkpoint_is_fetched_once(tmp_path: Path) -> None:
    server = Server(b"weights")

    for _ in range(2):
        with held(sha256(b"weights"), server.fetch, tmp_path) as path:
            assert path.read_bytes() == b"weights"

    assert (server.asked, files(tmp_path)) == (1, {f"{sha256(b'weights')}.safetensors"})


def test_processes_that_want_the_same_wait_for_one_fetch(tmp_path: Path) -> None:
    server = Server(b"weights", seconds=0.2)
    seen: list[bytes] = []

    def play() -> None:
        with held(sha256(b"weights"), server.fetch, tmp_path) as path:
            seen.append(path.read_bytes())

    threads = [threading.Thread(target=play) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert (server.asked, seen) == (1, [b"weights"] * 4)


def test_other_content_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    wanted = sha256(b"weights")

    fetch = Server(b"weighty").fetch
    with pytest.raises(WrongContent, match=f"not {wanted}"), held(wanted, fetch, tmp_path):
        pass

    assert files(tmp_path) == set()


def test_a_broken_fetch_leaves_nothing(tmp_path: Path) -> None:
    def fetch(path: Path) -> None:
        path.write_bytes(b"wei")
        raise ConnectionError("gone")

    with pytest.raises(ConnectionError), held(sha256(b"weights"), fetch, tmp_path):
        pass

    assert files(tmp_path) == set()


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    left = tmp_path / f".{sha256(b'weights')}.01234567.part"
    left.write_bytes(b"wei")

    kept(tmp_path, b"weights")

    assert not left.exists()


def test_a_damaged_file_is_fetched_again(tmp_path: Path) -> None:
    kept(tmp_path, b"weights").write_bytes(b"w31ghts")

    with held(sha256(b"weights"), Server(b"weights").fetch, tmp_path) as path:
        assert path.read_bytes() == b"weights"


def test_what_was_used_longest_ago_makes_room(tmp_path: Path) -> None:
    old, older, newest = (kept(tmp_path, b"%d" % age, age) for age in (100, 200, 0))

    make_room(tmp_path, kept=2)

    assert [path.exists() for path in (old, older, newest)] == [True, False, True]


def test_what_is_played_makes_no_room(tmp_path: Path) -> None:
    with held(sha256(b"a"), Server(b"a").fetch, tmp_path) as path:
        os.utime(path, (0, 0))

        make_room(tmp_path, kept=0)
        assert path.exists()
    make_room(tmp_path, kept=0)

    assert not path.exists()


def test_taking_up_and_making_room_at_once_gives_everybody_the_file(tmp_path: Path) -> None:
    wrong: list[str] = []

    def play(number: int) -> None:
        for turn in range(25):
            content = b"%d" % ((number + turn) % 3)
            with held(sha256(content), Server(content).fetch, tmp_path) as path:
                if path.read_bytes() != content:
                    wrong.append(path.name)
            make_room(tmp_path, kept=1)

    threads = [threading.Thread(target=play, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert wrong == []


def test_the_environment_says_where(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(FOLDER, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "hide-seek" / "checkpoints"

    monkeypatch.setenv(FOLDER, str(tmp_path / "mine"))
    assert default_folder() == tmp_path / "mine"
