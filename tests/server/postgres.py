"""A PostgreSQL server of the tests' own, from Debian's package; it forgets everything."""

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import psycopg
import pytest

NOBODY = 65534  # PostgreSQL refuses to run as root
DROP = {"user": NOBODY, "group": NOBODY, "extra_groups": []}


def programs() -> Path | None:
    """Where its programs are; None if it is not installed."""
    if found := shutil.which("initdb"):
        return Path(found).resolve().parent
    places = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return places[-1].parent if places else None


needs_postgres = pytest.mark.skipif(
    programs() is None or sys.platform != "linux",
    reason="PostgreSQL is not installed: apt-get install postgresql",
)


@cache
def server() -> Path:
    """The folder of its socket; the server is started on first use and ends with this process."""
    binaries = programs()
    assert binaries is not None
    folder = Path(tempfile.mkdtemp(prefix="hide-pg-"))
    rights = DROP if os.geteuid() == 0 else {}
    if rights:
        os.chown(folder, NOBODY, NOBODY)
    quiet = {"stdout": subprocess.DEVNULL, "cwd": folder, **rights}
    made = [binaries / "initdb", "-D", folder / "data", "-U", "hide", "-A", "trust", "-N"]
    subprocess.run([*made, "-E", "UTF8", "--locale=C"], check=True, **quiet)
    settings = ["listen_addresses=", f"unix_socket_directories={folder}", "fsync=off"]
    settings += ["max_connections=200", "full_page_writes=off", "synchronous_commit=off"]
    options = [part for setting in settings for part in ("-c", setting)]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            [binaries / "postgres", "-D", folder / "data", *options], stderr=log, **quiet
        )
    atexit.register(_end, process, folder)
    waiting = [binaries / "pg_isready", "-h", folder, "-U", "hide", "-t", "60", "-q"]
    while subprocess.run(waiting).returncode:
        assert process.poll() is None, (folder / "log").read_text()
    return folder


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    process.kill()
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


def address(name: str) -> str:
    """Of a database."""
    return f"postgresql+psycopg://hide@/{name}?host={server()}"


def create(name: str, template: str = "template0", encoding: str = "UTF8") -> str:
    """The address of a new database, a copy of another."""
    with psycopg.connect(f"host={server()} user=hide dbname=postgres", autocommit=True) as admin:
        admin.execute(
            f"CREATE DATABASE {name} TEMPLATE {template} ENCODING {encoding}"  # type: ignore
        )
    return address(name)


def exists(name: str) -> bool:
    """True if there is a database of this name."""
    with psycopg.connect(f"host={server()} user=hide dbname=postgres") as admin:
        found = admin.execute("SELECT FROM pg_database WHERE datname = %s", [name]).fetchone()
        return found is not None
