"""The simulator: the only PyBullet of the project.

PyBullet writes greetings to the process's standard output when it is imported and at every
connection; `quietly` keeps them out of whatever reads ours.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quietly() -> Iterator[None]:
    """Send the process's standard output to nowhere for a moment."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


with quietly():
    import pybullet  # noqa: F401
