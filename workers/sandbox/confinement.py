"""Closes the process that it runs in, for good: limits, capabilities, files, system calls.

It must come before the first thread (numpy starts some), because a thread that is already there
stays as free as it was. So it imports the standard library alone, and what it closes with.
"""

import ctypes
import json
import os
import resource
import sys
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

from workers.sandbox.limits import Limits

PR_CAPBSET_DROP = 24  # prctl(2)
LAST_CAPABILITY = 63  # of capabilities(7); those that a kernel lacks are refused
CAPABILITY_VERSION = 0x20080522  # capget(2), _LINUX_CAPABILITY_VERSION_3
KILLED_FIRST = "1000"  # proc(5), oom_score_adj


@dataclass(frozen=True)
class Confinement:
    """What is left to a process."""

    limits: Limits
    landlock: bool = False  # hold it to the paths below; otherwise something else does
    readable: tuple[str, ...] = ()
    writable: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()
    search: tuple[str, ...] = ()  # where modules are looked for, once it is closed

    def to_json(self) -> bytes:
        """As it travels to the process."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, text: bytes) -> "Confinement":
        """What to_json wrote."""
        fields = json.loads(text)
        fields["limits"] = Limits(**fields["limits"])
        return cls(**fields)


def confine(to: Confinement) -> None:
    """Closes this process.

    Raises:
        RuntimeError: it has threads, which would stay free.
        OSError, ImportError: the machine does not do it.
    """
    import pyseccomp  # noqa: F401  (it looks for libseccomp with programs, while it may start them)

    from workers.sandbox import system_calls

    if (threads := len(os.listdir("/proc/self/task"))) != 1:
        raise RuntimeError(f"a process with {threads} threads cannot be closed any more")
    _limit(to.limits)
    if not to.landlock and counts_threads_apart():
        resource.setrlimit(resource.RLIMIT_NPROC, (to.limits.threads, to.limits.threads))
    Path("/proc/self/oom_score_adj").write_text(KILLED_FIRST)
    _drop_capabilities()
    if to.landlock:
        _close_files(to)
    system_calls.close(metadata=to.landlock)


def _limit(limits: Limits) -> None:
    # DATA, not AS: allocators and CUDA reserve far more addresses than they use. What DATA does
    # not count, shared memory, is not to be had: see system_calls.
    for kind, most in (
        (resource.RLIMIT_DATA, limits.memory),
        (resource.RLIMIT_FSIZE, limits.file_size),
        (resource.RLIMIT_NOFILE, limits.open_files),
        (resource.RLIMIT_CPU, limits.cpu),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, most))


def counts_threads_apart() -> bool:
    """True if the kernel counts those of a user namespace, not all of the user's."""
    major, minor = os.uname().release.split(".")[:2]
    return (int(major), int(minor)) >= (5, 14)


def _drop_capabilities() -> None:
    """Nothing of root's rights is left, should this be root."""
    libc = ctypes.CDLL(None)  # without use_errno: landlock takes an old error for its own
    for capability in range(LAST_CAPABILITY + 1):
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)  # refused to all but root, who needs it
    header = (ctypes.c_uint32 * 2)(CAPABILITY_VERSION, 0)
    nothing = (ctypes.c_uint32 * 6)()
    if libc.capset(header, nothing):
        raise OSError("capabilities cannot be dropped")


def _close_files(to: Confinement) -> None:
    from landlock import FSAccess, Ruleset

    rules = Ruleset()
    read = FSAccess.READ_FILE | FSAccess.READ_DIR
    for path in to.readable:
        rules.allow(path, rules=read if os.path.isdir(path) else FSAccess.READ_FILE)
    for path in to.devices:
        rules.allow(path, rules=FSAccess.all_file() & ~FSAccess.EXECUTE)
    for path in to.writable:
        rules.allow(path, rules=FSAccess.all() & ~FSAccess.EXECUTE)
    own = FSAccess.READ_FILE | FSAccess.READ_DIR
    rules.allow(f"/proc/{os.getpid()}", rules=own)
    rules.apply()


def main() -> None:
    """Closes this process as standard input says, then runs the module that is named first."""
    to = Confinement.from_json(sys.stdin.buffer.read())
    confine(to)
    sys.path[:] = to.search
    sys.argv[:2] = sys.argv[1:2]
    import_module(sys.argv[0]).main()


if __name__ == "__main__":
    main()
