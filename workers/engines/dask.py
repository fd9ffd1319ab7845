"""A cluster of machines under Dask's scheduler. It places work and keeps no truth.

Dask knows who is there and moves jobs; it is asked for nothing else. No job is run twice by it: one
whose machine was lost has ended, and the ledger begins the next attempt, with a fence of its own.
"""

import contextlib
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from distributed import Client, Future

from workers.engines.engine import Ended
from workers.engines.member import JobLost, run_here

logger = logging.getLogger(__name__)

LOOK_EVERY = 1.0  # s between two looks at a cluster that tells nothing
CONNECT_LIMIT = 5.0  # s for the scheduler to answer
CLOSE_LIMIT = 4.0  # s


@dataclass
class _Work:
    job: Any
    limit: float
    cancelled: bool = False
    future: Future | None = None  # None: queued


class DaskEngine:
    """An `Engine` over a Dask cluster; one thread of its own hands out work and takes what ended.

    Args:
        function: takes a job; importable by name on every machine.
        scheduler: its address; while nobody answers there, work waits.
        security: Dask's, for an address that begins with tls.
        encode: a job as a JSON document, which is what travels.
        on_ended: called, in the engine's thread, when `ended` has something new.
    """

    name = "dask"

    def __init__(
        self,
        function: Callable[[Any], None],
        *,
        scheduler: str,
        security: Any = None,
        encode: Callable[[Any], Any] = lambda job: job,
        on_ended: Callable[[], None] = lambda: None,
    ):
        self.function = f"{function.__module__}:{function.__qualname__}"
        self.scheduler, self.security = scheduler, security
        self.fault: str | None = f"{scheduler} was not asked yet"  # why nothing can be placed
        self._encode, self._on_ended = encode, on_ended
        self._work: dict[str, _Work] = {}  # in the order of their turn
        self._ended: SimpleQueue[Ended] = SimpleQueue()
        self._lock = threading.Lock()  # of _work; never held while waiting for Dask
        self._changed = threading.Event()
        self._closed = False
        self._slots = 0
        self._client: Client | None = None  # the keeper's alone, until it has ended
        self._keeper = threading.Thread(target=self._keep, name="dask engine", daemon=True)
        self._keeper.start()

    # --- the port ---

    def submit(self, key: str, job: Any, limit: float) -> None:
        """Queue a job for at most `limit` seconds of work; a key of the inventory is left alone.

        Raises:
            RuntimeError: the engine is closed.
        """
        with self._lock:
            if self._closed:
                raise RuntimeError("The engine is closed; nothing can be submitted to it.")
            self._work.setdefault(key, _Work(self._encode(job), limit))
        self._changed.set()

    def cancel(self, key: str) -> None:
        """Drop a key; the machine that runs it kills its processes within a second."""
        with self._lock:
            if key in self._work:
                self._work[key].cancelled = True
        self._changed.set()

    def inventory(self) -> set[str]:
        """Keys that are queued or running."""
        with self._lock:
            return set(self._work)

    def ended(self) -> list[Ended]:
        """Everything that ended since the last call."""
        ended = []
        with contextlib.suppress(Empty):
            while True:
                ended.append(self._ended.get_nowait())
        return ended

    def slots(self) -> int:
        """How many jobs the machines that are there run at a time."""
        return self._slots

    def close(self) -> None:
        """Drop everything; the machines kill what runs once they see that nobody wants it."""
        with self._lock:
            self._closed = True
        self._changed.set()
        self._keeper.join(CLOSE_LIMIT)

    # --- the engine's thread ---

    def _keep(self) -> None:
        while not self._closed:
            self._changed.clear()
            try:
                self._look()
                self.fault = None
            except (OSError, TimeoutError) as error:
                self.fault, self._slots = f"{self.scheduler} does not answer: {error}", 0
            except Exception as error:
                self.fault = f"{type(error).__name__}: {error}"
                logger.exception("The engine stumbled and goes on")
            self._changed.wait(LOOK_EVERY)
        self._disconnect()

    def _look(self) -> None:
        with self._lock:
            works = list(self._work.items())
        for key, work in works:
            self._look_after(key, work)
        client = self._connected()
        threads = client.sync(client.scheduler.ncores, workers=None, callback_timeout=CONNECT_LIMIT)
        self._slots = sum(threads.values())
        self._place(client)

    def _connected(self) -> Client:
        if self._client is None or self._client.status == "closed":
            self._disconnect()
            self._client = Client(
                self.scheduler,
                security=self.security,
                timeout=CONNECT_LIMIT,
                set_as_default=False,
                name="hide",
            )
        return self._client

    def _disconnect(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(Exception):  # whatever it says, it is given up
                client.close(timeout=CLOSE_LIMIT / 2)

    def _look_after(self, key: str, work: _Work) -> None:
        future = work.future
        if work.cancelled:
            if future:
                future.release()
            self._end(key, Ended(key, "cancelled", cancelled=True))
        elif future and future.status != "pending":
            self._end(key, Ended(key, _reason(future)))
            future.release()

    def _end(self, key: str, ended: Ended) -> None:
        with self._lock:
            del self._work[key]
        self._ended.put(ended)
        self._on_ended()

    def _place(self, client: Client) -> None:
        """Hands out work, as much as is run at once, so that the rest can be cancelled."""
        with self._lock:
            works = list(self._work.items())
        room = self._slots - sum(work.future is not None for _, work in works)
        waiting = [(key, work) for key, work in works if not (work.future or work.cancelled)]
        for key, work in waiting[: max(0, room)]:
            work.future = client.submit(
                run_here, self.function, work.job, work.limit, key=key, pure=False, retries=0
            )
            work.future.add_done_callback(lambda _: self._changed.set())


def _reason(future: Future) -> str | None:
    """Why a job came to nothing; None if it did not."""
    if future.status == "finished":
        return None
    if future.status != "error":
        return "the scheduler lost it"
    error = future.exception(timeout=CONNECT_LIMIT)
    if isinstance(error, JobLost):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return "its worker disappeared"
    return f"{type(error).__name__}: {error}"
