"""Looks at this machine for what an evaluation needs."""

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import hide_tasks
from hide_tasks.machine import installed
from workers.evaluation import count_cpus

NEEDED = ("numpy", "numba", "pybullet", "pydantic", "msgpack", "pebble", "rerun-sdk", "typer")
ROOM = 2 * 2**30  # bytes: the recordings of some evaluations


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    what: str
    good: bool
    found: str
    remedy: str = ""


def findings() -> list[Finding]:
    """Everything that was looked at; takes no longer than a second."""
    looks: list[Callable[[], Finding]] = [_python, _packages, _processors, _cache, _space]
    return [look() for look in looks]


def _python() -> Finding:
    good = sys.version_info[:2] == (3, 11)
    return Finding("Python", good, platform.python_version(), "use Python 3.11: pybullet needs it")


def _packages() -> Finding:
    versions = {name: installed(name) for name in NEEDED}
    missing = [name for name, version in versions.items() if version is None]
    found = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    return Finding("packages", not missing, found, f"install {', '.join(missing)}: make setup")


def _processors() -> Finding:
    count = count_cpus()
    return Finding("processors", count > 0, f"{count}; as many episodes at a time")


def _cache() -> Finding:
    """Compiled kernels are kept beside their sources; each worker compiles anew if it cannot."""
    folder = Path(
        os.environ.get("NUMBA_CACHE_DIR") or str(Path(hide_tasks.__file__).parent / "bullet")
    )
    found, remedy = str(folder), "set NUMBA_CACHE_DIR to a folder that can be written"
    try:
        with tempfile.TemporaryFile(dir=folder):
            return Finding("kernel cache", True, found)
    except OSError as error:
        return Finding("kernel cache", False, f"{found}: {error.strerror}", remedy)


def _space() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free
    found = f"{free / 2**30:.1f} GiB free in {Path.cwd()}"
    return Finding("disk", free > ROOM, found, "make room: recordings take about 1 MB an episode")
