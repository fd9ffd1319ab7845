"""How much of the machine a policy's process may use."""

import os
from dataclasses import dataclass

MEMORY = "HIDE_SANDBOX_MEMORY"  # in the environment: GiB that a policy's process may take
GIB = 2**30


@dataclass(frozen=True)
class Limits:
    """Of one process; it cannot raise them."""

    memory: int = 8 * GIB  # bytes of its own, the code's mapped files apart
    scratch: int = GIB // 2  # bytes of its /tmp, where that is a file system of its own
    file_size: int = GIB // 4  # bytes of one file that it writes
    open_files: int = 512
    threads: int = 1024  # counted for an ordinary user in bubblewrap; root's are not counted
    cpu: int = 4 * 3600  # s of processor time; a process that used them up is started afresh

    @classmethod
    def of_environment(cls) -> "Limits":
        """These limits, with the memory that the environment grants.

        Raises:
            ValueError: it grants no number.
        """
        granted = os.environ.get(MEMORY)
        if granted is None:
            return cls()
        try:
            memory = int(float(granted) * GIB)
        except (ValueError, OverflowError):
            memory = 0
        if memory <= 0:
            raise ValueError(f"{MEMORY}={granted}: expected a number of GiB, such as 8.")
        return cls(memory=memory)
