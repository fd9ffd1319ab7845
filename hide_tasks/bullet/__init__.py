"""The simulator: the only PyBullet of the project.

PyBullet writes greetings to the process's own output when it is imported and at every connection;
`quietly` keeps them out of whatever reads ours.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

STREAMS = (1, 2)


@contextmanager
def quietly() -> Iterator[None]:
    """Send what the process writes to standard output and error to nowhere for a moment."""
    sys.stdout.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    kept = [os.dup(stream) for stream in STREAMS]
    for stream in STREAMS:
        os.dup2(nowhere, stream)
    try:
        yield
    finally:
        for stream, copy in zip(STREAMS, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


with quietly():
    import pybullet  # noqa: F401
