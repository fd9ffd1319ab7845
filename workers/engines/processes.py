"""What holds for every process of an engine: few threads, a log, and no life after its parent's."""

import faulthandler
import multiprocessing
import os
import threading
from multiprocessing.connection import wait
from pathlib import Path

THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def limit_threads() -> None:
    """Processes started from now on calculate in one thread; this one keeps what it has loaded."""
    os.environ.update(dict.fromkeys(THREAD_LIMITS, "1"))


def prepare_process(log: Path = Path(os.devnull)) -> None:
    """Called first in every worker: it neither outlives its parent nor prints where that does."""
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(output, 1)
    os.dup2(output, 2)
    faulthandler.enable()
    threading.Thread(target=_die_with_parent, daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
