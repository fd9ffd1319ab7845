"""Tries a sandbox: a process that is closed by it attempts what it must not do."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from workers.sandbox import bubblewrap
from workers.sandbox.choice import Sandbox
from workers.sandbox.launch import launch
from workers.sandbox.view import of_checkpoint

LIMIT = 120.0  # s; a busy machine is no reason to go without
CLOSED = "closed"


def fault(sandbox: Sandbox) -> str:
    """Why a sandbox cannot be had on this machine; empty if it can."""
    if sys.platform != "linux":
        return "it needs Linux"
    if sandbox is Sandbox.BUBBLEWRAP and not bubblewrap.program():
        return f"{bubblewrap.PROGRAM} is not installed (Debian: apt-get install bubblewrap)"
    started = launch(sandbox, 0, of_checkpoint(Path(__file__)), host=__name__)
    try:
        done = subprocess.run(
            started.command,
            input=started.tells,
            env=started.environment,
            pass_fds=started.descriptors,
            capture_output=True,
            timeout=LIMIT,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    finally:
        started.passed_on()
        started.end()
    said = done.stdout.decode(errors="replace").strip()
    if done.returncode == 0 and said == CLOSED:
        return ""
    return said or _last_line(done.stderr) or f"it ended with {done.returncode}"


def _last_line(output: bytes) -> str:
    lines = output.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def main() -> None:
    """Tells on standard output whether this process is closed, or what it could do."""
    attempts: dict[str, Callable[[], object]] = {
        "open a socket": socket.socket,
        "start a process": os.fork,
        "look around": lambda: Path("/etc/passwd").read_bytes(),
        "write": lambda: Path(__file__).with_name("written").touch(),
    }
    done = [what for what, attempt in attempts.items() if _succeeds(attempt)]
    print(f"a process in it could {' and '.join(done)}" if done else CLOSED)  # noqa: T201


def _succeeds(attempt: Callable[[], object]) -> bool:
    try:
        attempt()
    except OSError:
        return False
    return True
