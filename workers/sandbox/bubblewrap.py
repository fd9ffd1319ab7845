"""The sandbox of bubblewrap: namespaces in which a process sees nothing but what it is given."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from workers.sandbox.limits import Limits
from workers.sandbox.view import SCRATCH as SCRATCH
from workers.sandbox.view import View, code

PROGRAM = "bwrap"
SYSTEM = (
    *("/usr", "/bin", "/lib", "/lib32", "/lib64", "/sbin", "/etc/ld.so.cache"),
    "/etc/alternatives",  # Debian's numeric libraries are links to there
    "/sys/devices/system",  # how many processors there are
)
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
        view: which files there are; links that are to be covered lead nowhere.
        limits: how large its /tmp is.
        devices: files under /dev that it may use.
        folder: where the command starts, if it is seen.
    """
    found = [*ALONE, "--size", str(limits.scratch), "--tmpfs", str(SCRATCH)]
    found += ["--proc", "/proc", "--dev", "/dev"]
    for name in SYSTEM:
        found += ["--ro-bind-try", name, name]
    for device in devices:
        found += ["--dev-bind-try", str(device), str(device)]
    covered: list[Path] = []
    for part in sorted(view.parts, key=lambda path: len(path.parts)):
        found += _bind(part)
        for path in view.covered(part):
            if path.is_dir() and not path.is_symlink():
                found += ["--tmpfs", str(path)]
                covered.append(path)
            elif path.is_file() and not path.is_symlink():
                found += ["--ro-bind", "/dev/null", str(path)]
    for path in view.whole:
        found += _bind(path)
    for path in code().values():
        found += ["--symlink", str(path), str(CODE / path.name)]
    # The mounts that bubblewrap itself makes are memory that nobody counts.
    for path in (Path("/dev"), Path("/"), *covered):
        found += ["--remount-ro", str(path)]
    return [*found, "--chdir", str(folder if view.includes(folder) else SCRATCH)]


def _bind(path: Path) -> list[str]:
    return ["--ro-bind", str(path), str(path)]
