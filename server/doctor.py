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
from workers.sandbox.choice import Sandbox, offers

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
    """Everything that was looked at; takes a second or two."""
    looks: list[Callable[[], Finding]] = [_python, _packages, _processors, _cache, _space, _sandbox]
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


def _sandbox() -> Finding:
    """The best sandbox that works here, tried; and why the others do not."""
    tried = [one for one in offers() if one.sandbox is not Sandbox.NONE]
    usable = [one.sandbox.value for one in tried if not one.missing]
    faults = [f"no {one.sandbox}: {one.missing}" for one in tried if one.missing]
    taken = f"{usable[0]} is taken" if usable else "none: policies can do what you can"
    also = [f"{', '.join(usable[1:])} would do as well"] if usable[1:] else []
    remedy = "install bubblewrap, or use Linux 5.13 or newer with Landlock and libseccomp2"
    return Finding("sandbox", bool(usable), "; ".join([taken, *also, *faults]), remedy)


def _space() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free
    found = f"{free / 2**30:.1f} GiB free in {Path.cwd()}"
    return Finding("disk", free > ROOM, found, "make room: recordings take about 1 MB an episode")
