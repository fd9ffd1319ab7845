"""The sandbox of bubblewrap: namespaces in which a process sees nothing but what it is given."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from workers.sandbox.limits import Limits
from workers.sandbox.view import View, code

PROGRAM = "bwrap"
SYSTEM = ("/usr", "/bin", "/lib", "/lib32", "/lib64", "/sbin", "/etc/ld.so.cache")
MACHINE = ("/sys/devices/system",)  # how many processors there are
SCRATCH = Path("/tmp")  # as the process sees it
CODE = Path("/code")  # with links to our modules
ALONE = (
    "--unshare-all",
    "--unshare-user",
    "--disable-userns",
    "--die-with-parent",
    "--cap-drop",
    "ALL",
    "--hostname",
    "policy",
)


def program() -> str | None:
    """Its path, if it is installed."""
    return shutil.which(PROGRAM)


def options(view: View, limits: Limits, devices: Sequence[Path], folder: Path) -> list[str]:
    """Everything between `bwrap` and the command.

    Args:
        view: which files there are.
        limits: how large its /tmp is.
        devices: files under /dev that it may use.
        folder: where the command starts, if it is seen.
    """
    found = [*ALONE, "--size", str(limits.scratch), "--tmpfs", str(SCRATCH)]
    found += ["--proc", "/proc", "--dev", "/dev"]
    for path in (*SYSTEM, *MACHINE):
        found += ["--ro-bind-try", path, path]
    for device in devices:
        found += ["--dev-bind-try", str(device), str(device)]
    for part in view.parts:
        found += [*_bind(part), *_covers(view, part)]
    for path in view.whole:
        found += _bind(path)
    for path in code().values():
        found += ["--symlink", str(path), str(CODE / path.name)]
    # The mounts that bubblewrap itself makes are memory that nobody counts.
    found += ["--remount-ro", "/dev", "--remount-ro", "/"]
    return [*found, "--chdir", str(folder if view.includes(folder) else SCRATCH)]


def _bind(path: Path) -> list[str]:
    return ["--ro-bind", str(path), str(path)]


def _covers(view: View, part: Path) -> Iterator[str]:
    for path in view.covered(part):
        if path.is_dir() and not path.is_symlink():
            yield from ("--size", "4096", "--tmpfs", str(path), "--remount-ro", str(path))
        elif not path.is_symlink():  # one leads to what is not there
            yield from ("--ro-bind", "/dev/null", str(path))
