"""Starting a server: what keeps it from starting is one clear line, and nothing is touched."""

import socket
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from server import cli, serve
from tests.processes import gone
from tests.server import ledgers
from tests.server.running import RunningServer, until
from workers.simulator_process import descendants


def refused(capfd: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line that `hide serve` says before it gives up."""
    with pytest.raises(SystemExit) as exited:
        cli.main(["serve", "--port", "0", *map(str, arguments)])
    output = capfd.readouterr()
    assert (exited.value.code, output.out, output.err.count("\n")) == (2, "", 1)
    assert output.err.startswith("hide: ")
    return output.err


def everything(folder: Path) -> dict[str, bytes]:
    """All files below a folder and what they hold."""
    return {str(file): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@contextmanager
def taken_port() -> Iterator[int]:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        yield listening.getsockname()[1]


def test_a_port_in_use(capfd, tmp_path: Path) -> None:
    with taken_port() as port:
        line = refused(capfd, "--data", tmp_path / "data", "--port", port)

    assert f"Port {port} of 127.0.0.1 is in use; give another --port." in line
    assert not (tmp_path / "data").exists()


def test_answers_are_not_held_back() -> None:
    """Of other sockets asyncio leaves Nagle's algorithm on: 40 ms between a head and its body."""
    with (
        serve.bound("127.0.0.1", 0) as listening,
        socket.create_connection(listening.getsockname()),
    ):
        accepted, _ = listening.accept()
        with accepted:
            assert accepted.proto == socket.IPPROTO_TCP


def test_an_address_that_others_reach(capfd, tmp_path: Path) -> None:
    line = refused(capfd, "--data", tmp_path / "data", "--host", "0.0.0.0")

    assert "--host 0.0.0.0" in line and "127.0.0.1" in line
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "options", [("--host", "192.0.2.7"), ("--public-url", "https://lab.example.org")]
)
def test_an_address_that_others_reach_and_nobody_guards(
    capfd, tmp_path: Path, options: tuple[str, str]
) -> None:
    line = refused(capfd, "--data", tmp_path / "data", *options, "--no-token")

    assert options[1] in line and "--auth users" in line
    assert not (tmp_path / "data").exists()


def test_a_sandbox_that_there_is_not(capfd, tmp_path: Path) -> None:
    line = refused(capfd, "--data", tmp_path / "data", "--sandbox", "docker")

    assert "No sandbox 'docker'" in line and "best, bubblewrap, landlock, none" in line
    assert not (tmp_path / "data").exists()


def test_a_data_folder_that_is_a_file(capfd, tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.write_text("a letter")

    line = refused(capfd, "--data", data)

    assert f"{data} cannot be written" in line
    assert data.read_text() == "a letter"


def test_a_corrupt_ledger(capfd, tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite3").write_bytes(b"not a database, but long enough " * 200)
    before = everything(tmp_path)

    line = refused(capfd, "--data", tmp_path)

    assert "cannot be read as a ledger" in line
    assert everything(tmp_path) == before


def test_a_ledger_with_damaged_pages(capfd, tmp_path: Path) -> None:
    ledgers.opened(tmp_path).close()
    file = tmp_path / "ledger.sqlite3"
    content = bytearray(file.read_bytes())
    content[8192:40960] = b"\xff" * 32768
    file.write_bytes(content)
    before = file.read_bytes()

    line = refused(capfd, "--data", tmp_path)

    assert "ledger.sqlite3" in line and ("damaged" in line or "cannot be read" in line)
    assert file.read_bytes() == before


def test_a_ledger_of_a_newer_version(capfd, tmp_path: Path) -> None:
    ledgers.opened(tmp_path).close()
    with sqlite3.connect(tmp_path / "ledger.sqlite3") as opened:
        opened.execute("UPDATE alembic_version SET version_num = '9999'")
    opened.close()
    before = (tmp_path / "ledger.sqlite3").read_bytes()

    line = refused(capfd, "--data", tmp_path)

    assert "newer version (revision 9999" in line and "Update hide-seek" in line
    assert (tmp_path / "ledger.sqlite3").read_bytes() == before


def test_another_programs_database(capfd, tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "ledger.sqlite3") as opened:
        opened.execute("CREATE TABLE recipes (name TEXT)")
    opened.close()
    before = everything(tmp_path)

    line = refused(capfd, "--data", tmp_path)

    assert "another program" in line
    assert everything(tmp_path) == before


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("PORT", "eighty"),
        ("WORKERS", "-1"),
        ("ALLOW_PYTHON", "perhaps"),
        ("EPISODE_LIMIT", "0"),
        ("AUTH", "nobody"),
        ("RATE", "fast"),
        ("PUBLIC_URL", "lab.example.org"),
    ],
)
def test_a_wrong_environment_variable(
    capfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, value: str
) -> None:
    monkeypatch.setenv(f"HIDE_SERVER_{variable}", value)
    with pytest.raises(SystemExit) as exited:
        cli.main(["serve", "--data", str(tmp_path / "data")])

    line = capfd.readouterr().err
    assert exited.value.code == 2
    assert f"HIDE_SERVER_{variable}={value}" in line and line.count("\n") == 1
    assert not (tmp_path / "data").exists()


def test_a_data_folder_in_use_and_a_stop_that_leaves_nothing_behind(capfd, tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningServer(data, "--no-references", workers=1) as server:
        line = refused(capfd, "--data", data)
        health = server.get("/health/ready")
        below = descendants(server.process.pid)

    assert "in use by another server" in line
    assert (health["status"], health["workers"]) == ("ok", 1)
    assert server.process.returncode == 0
    assert until(lambda: gone(below), "the end of its workers", 10)
