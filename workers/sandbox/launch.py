"""How a policy's process is started, with or without a sandbox around it."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from workers.engines.processes import THREAD_LIMITS
from workers.sandbox import bubblewrap
from workers.sandbox.choice import Sandbox
from workers.sandbox.confinement import Confinement
from workers.sandbox.limits import Limits
from workers.sandbox.view import View, code

SCRATCH = "hide-worker-"  # then the process's id: begins the names of folders for a while
HOST = "workers.policy_host"
KEPT = ("PATH", "LANG", "LC_ALL", "LC_CTYPE", "TZ", "CUDA_VISIBLE_DEVICES", *THREAD_LIMITS)
KEYS = "HIDE_REMOTE_KEYS"  # of policy servers: nothing for a policy to read
NOBODY = "policy"  # who a closed process believes to be
# What calculating libraries look at, and the accelerators, should there be any.
PROC = ("/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/driver/nvidia")
DEVICES = ("/dev/null", "/dev/zero", "/dev/random", "/dev/urandom")
ACCELERATORS = "nvidia*"


@dataclass
class Launch:
    """What starts a process; `end` removes what it leaves behind."""

    command: list[str]
    environment: dict[str, str]
    tells: bytes = b""  # goes to its standard input
    descriptors: list[int] = field(default_factory=list)  # passed on, then closed here
    scratch: Path | None = None
    folder: Path | None = None  # where it starts; None: here

    def passed_on(self) -> None:
        """Closes the descriptors here; the process has its own, if it was started."""
        while self.descriptors:
            os.close(self.descriptors.pop())

    def end(self) -> None:
        """Removes the process's folder."""
        if self.scratch:
            shutil.rmtree(self.scratch, ignore_errors=True)


def launch(
    sandbox: Sandbox, connection: int, view: View, *, threads: int | None = None, host: str = HOST
) -> Launch:
    """What starts a process that serves on a connection.

    Args:
        sandbox: what is around it.
        connection: the number of its socket.
        view: what it sees, in a sandbox.
        threads: for its numeric libraries.
        host: the module that serves, once the process is closed.

    Raises:
        OSError: there is no room for its folder.
    """
    if sandbox is Sandbox.BUBBLEWRAP:
        return _wrapped(connection, view, threads, host)
    if sandbox is Sandbox.LANDLOCK:
        return _closed(connection, view, threads, host)
    path = os.pathsep.join(os.path.abspath(part) for part in sys.path)
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
    environment.pop(KEYS, None)
    # -P: the researcher's folder comes first only once our own modules are imported.
    command = [sys.executable, "-P", "-m", host, str(connection)]
    return Launch(command, environment | _threads(threads))


def _wrapped(connection: int, view: View, threads: int | None, host: str) -> Launch:
    limits = Limits.of_environment()
    options = bubblewrap.options(view, limits, accelerators(), Path.cwd())
    told = _in_memory("\0".join(options).encode())
    to = Confinement(limits, search=_strings((bubblewrap.CODE, *view.search)))
    wrapped = [bubblewrap.program() or bubblewrap.PROGRAM, "--args", str(told), "--"]
    return Launch(
        wrapped + _command(host, connection),
        _environment(bubblewrap.CODE, bubblewrap.SCRATCH, threads),
        to.to_json(),
        [told],
    )


def _closed(connection: int, view: View, threads: int | None, host: str) -> Launch:
    scratch = Path(tempfile.mkdtemp(prefix=f"{SCRATCH}{os.getpid()}-")).resolve()
    try:
        temporary = scratch / "tmp"
        temporary.mkdir()
        mirrors = _mirrors(scratch, view)
        links = scratch / "code"
        _link(links, code().values())
        shown = [child for part in view.parts for child in view.shown(part)]
        devices = [Path(path) for path in DEVICES] + accelerators()
        to = Confinement(
            Limits.of_environment(),
            landlock=True,
            readable=_existing(
                (*view.whole, *shown, *bubblewrap.SYSTEM, *PROC, links, *mirrors.values())
            ),
            writable=(str(temporary),),
            devices=_existing(devices),
            search=_strings((links, *(mirrors.get(path, path) for path in view.search)))
            + _strings(mirrors[part] for part in view.parts if part not in view.search),
        )
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    environment = _environment(links, temporary, threads)
    folder = None if view.includes(Path.cwd()) else temporary
    return Launch(
        _command(host, connection), environment, to.to_json(), scratch=scratch, folder=folder
    )


def _mirrors(scratch: Path, view: View) -> dict[Path, Path]:
    """Folders of links: Python lists where it searches, and Landlock cannot show a list in part."""
    mirrors = {}
    for number, part in enumerate(view.parts):
        mirrors[part] = scratch / f"part{number}"
        _link(mirrors[part], view.shown(part))
    return mirrors


def _link(folder: Path, paths: Iterable[Path]) -> None:
    folder.mkdir()
    for path in paths:
        if not (folder / path.name).is_symlink():
            (folder / path.name).symlink_to(path)


def _command(host: str, connection: int) -> list[str]:
    # -s: no modules from a home. What serves is named for those who look at the processes.
    return [sys.executable, "-P", "-s", "-m", "workers.sandbox.confinement", host, str(connection)]


def _environment(links: Path, temporary: Path, threads: int | None) -> dict[str, str]:
    kept = {name: os.environ[name] for name in KEPT if name in os.environ}
    given = {"PYTHONPATH": links, "HOME": temporary, "TMPDIR": temporary, "USER": NOBODY}
    fixed = {"PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1", "LOGNAME": NOBODY}
    return kept | {name: str(value) for name, value in given.items()} | fixed | _threads(threads)


def _threads(count: int | None) -> dict[str, str]:
    return {} if count is None else dict.fromkeys(THREAD_LIMITS, str(count))


def accelerators() -> list[Path]:
    """The device files of NVIDIA's accelerators."""
    return sorted(path for path in Path("/dev").glob(ACCELERATORS))


def _in_memory(content: bytes) -> int:
    """A file descriptor to read it from."""
    descriptor = os.memfd_create("options")
    os.write(descriptor, content)
    os.lseek(descriptor, 0, os.SEEK_SET)
    return descriptor


def _strings(paths: Iterable[Path]) -> tuple[str, ...]:
    return tuple(map(str, paths))


def _existing(paths: Iterable[Path | str]) -> tuple[str, ...]:
    return tuple(str(path) for path in paths if os.path.exists(path))
