"""Policies that do what the instruction says, and what it says is hostile.

Each answers with what came of it: "done", or the name of the exception.
"""

import asyncio
import ctypes
import fcntl
import mmap
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

SYSTEM_CALLS = {"io_uring_setup": 425, "clone3": 435, "unshare": 272, "ptrace": 101, "mount": 165}
FORKS = 200  # at most: a bomb that goes off must not take the machine with it
PIECE = 64 * 2**20  # bytes
F_SETOWN = 8


def opens_a_socket(_: str) -> None:
    socket.socket().close()


def connects(port: str) -> None:
    socket.create_connection(("127.0.0.1", int(port)), timeout=5).close()


def sends_to_an_abstract_socket(name: str) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
        out.sendto(b"hello", f"\0{name}")


def reads(path: str) -> None:
    assert Path(path).read_bytes(), "there is nothing in it"


def lists(path: str) -> None:
    assert os.listdir(path), "there is nothing in it"


def looks_for(path: str) -> None:
    """Goes everywhere that it can see, but for the system and the interpreter, which are large."""
    name, large = Path(path).name, {"/proc", "/sys", "/usr", sys.prefix, sys.base_prefix}
    for folder, folders, files in os.walk("/"):
        if folder in large:
            folders.clear()
        if name in files:
            (Path(folder) / name).read_bytes()
            return
    raise FileNotFoundError(name)


def writes(path: str) -> None:
    Path(path).write_text("was here")


def deletes(path: str) -> None:
    Path(path).unlink()


def truncates(path: str) -> None:
    os.truncate(path, 0)


def changes_the_mode(path: str) -> None:
    os.chmod(path, 0o777)


def starts_a_program(_: str) -> None:
    subprocess.run(["true"], check=True)


def bombs(_: str) -> None:
    for _ in range(FORKS):
        if os.fork() == 0:
            time.sleep(20)
            os._exit(0)


def kills(pid: str) -> None:
    os.kill(int(pid), signal.SIGKILL)


def kills_all(_: str) -> None:
    os.kill(-1, signal.SIGKILL)


def signals_by_a_file(pid: str) -> None:
    ours, _ = socket.socketpair()
    fcntl.fcntl(ours, F_SETOWN, int(pid))


def outlives_its_parent(_: str) -> None:
    if ctypes.CDLL(None, use_errno=True).prctl(1, 0, 0, 0, 0):  # PR_SET_PDEATHSIG
        raise PermissionError
    os.setsid()


def eats_memory(_: str) -> None:
    eaten = []
    while True:
        eaten.append(np.empty(PIECE, np.uint8))  # what is never touched is counted as well


def eats_shared_memory(_: str) -> None:
    mmap.mmap(-1, PIECE).close()


def eats_memory_in_threads(_: str) -> None:
    def eat() -> None:
        try:
            eats_memory("")
        except MemoryError:
            failed.set()

    failed = threading.Event()
    threads = [threading.Thread(target=eat) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed.is_set():
        raise MemoryError


def fills_the_disk(_: str) -> None:
    with open(Path(os.environ["TMPDIR"]) / "full", "wb") as file:
        while True:
            file.write(bytes(PIECE))


def calls(name: str) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.syscall(SYSTEM_CALLS[name], 0, 0, 0, 0, 0) < 0:
        raise OSError(ctypes.get_errno(), name)


def raises_its_limits(_: str) -> None:
    import resource

    unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    try:
        resource.setrlimit(resource.RLIMIT_DATA, unlimited)
    except ValueError:
        raise PermissionError from None


def sleeps(_: str) -> None:
    time.sleep(600)


def spins(_: str) -> None:
    while True:
        pass


def kills_itself(_: str) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def calculates(_: str) -> None:
    """What honest policies do: threads, files of its own, a pair of sockets."""
    with ThreadPoolExecutor(4) as pool:
        sums = list(pool.map(lambda _: float(np.ones(300).dot(np.ones(300))), range(8)))
    with tempfile.NamedTemporaryFile("w+") as file:
        file.write("mine")
        file.flush()
        kept = Path(file.name).read_text()
    slept = asyncio.run(asyncio.sleep(0, "slept"))
    assert (sums, kept, slept) == ([300.0] * 8, "mine", "slept")


class Hostile:
    """Does `instruction`: the name of a function above, then what it is done to."""

    def reset(self, instruction, policy_seed):
        self.instruction = instruction

    def act(self, observation):
        name, _, argument = self.instruction.partition(" ")
        try:
            globals()[name](argument)
        except MemoryError:
            return "MemoryError"
        except (OSError, AssertionError) as error:
            return type(error).__name__
        return "done"


class KillsItself:
    """Ends its process in the first so many episodes that this test plays; a file counts them."""

    deaths = 0

    def reset(self, instruction, policy_seed):
        pass

    def act(self, observation):
        from hide_tasks.contract import Stop

        counted = Path("deaths")
        died = int(counted.read_text()) if counted.exists() else 0
        if died < self.deaths:
            counted.write_text(str(died + 1))
            os.kill(os.getpid(), signal.SIGKILL)
        return Stop()


class KillsItselfAtOnce(KillsItself):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)


class KillsItselfTwice(KillsItself):
    deaths = 2


class KillsItselfAlways(KillsItself):
    deaths = 99
