"""A pool of processes on this machine. It places work and kills what is late; it keeps no truth."""

import contextlib
import logging
import math
import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Generic, TypeVar, cast

from pebble import ProcessPool

from workers.engines.engine import Ended
from workers.engines.processes import limit_threads, prepare_process

logger = logging.getLogger(__name__)

Job = TypeVar("Job")
Result = TypeVar("Result")

ATTEMPTS = 3
LOOK_EVERY = 1.0  # s between two looks at a pool that tells nothing
BEGIN_LIMIT = 60.0  # s until a process has taken its job; a new one is there after two
GRACE = 1.5  # s that processes may take to end when they are asked to


@dataclass(frozen=True)
class Finished(Generic[Job, Result]):
    """A job and what it returned."""

    job: Job
    result: Result


@dataclass(frozen=True)
class Lost(Generic[Job]):
    """A job whose attempt came to nothing, through no fault of a policy."""

    job: Job
    reason: str
    attempt: int
    final: bool  # it is not tried again


@dataclass
class _Attempt(Generic[Job]):
    job: Job
    number: int = 1


@dataclass
class _Work(Generic[Job, Result]):
    job: Job
    limit: float
    cancelled: bool = False
    future: Future[Result] | None = None  # None: queued
    placed_at: float = 0.0
    placings: int = 0


class LocalEngine(Generic[Job, Result]):
    """An `Engine` over a Pebble pool; one thread of its own hands out work and takes what ended.

    Args:
        function: takes a job; importable by name in a fresh interpreter.
        workers: how many processes.
        time_limit: seconds for one attempt of `run`; `submit` is told its own.
        log: file that takes what the processes print, native libraries and crashes included.
        recycle_after: a process is replaced after so many jobs, before what it leaks adds up.
        on_ended: called, in the engine's thread, when `ended` has something new.
    """

    name = "local"

    def __init__(
        self,
        function: Callable[[Job], Result],
        *,
        workers: int,
        time_limit: float = math.inf,
        log: Path = Path(os.devnull),
        recycle_after: int = 50,
        on_ended: Callable[[], None] | None = None,
    ):
        self.function = function
        self.workers = workers
        self.time_limit = time_limit
        self.log = log
        self.recycle_after = recycle_after
        self._on_ended = on_ended
        self._work: dict[str, _Work[Job, Result]] = {}  # in the order of their turn
        self._ended: SimpleQueue[Ended] = SimpleQueue()
        self._lock = threading.Lock()  # of _work and _closed; never held while waiting for Pebble
        self._changed = threading.Event()
        self._closed = False
        self._keeper = threading.Thread(target=self._keep, name="engine", daemon=True)
        self._pool: ProcessPool | None = None  # the keeper's alone, until it has ended

    # --- the port ---

    def submit(self, key: str, job: Job, limit: float) -> None:
        """Queue a job for at most `limit` seconds of work; a key of the inventory is left alone.

        Raises:
            RuntimeError: the engine is closed.
        """
        with self._lock:
            if self._closed:
                raise RuntimeError("The engine is closed; nothing can be submitted to it.")
            self._work.setdefault(key, _Work(job, limit))
            if not self._keeper.is_alive():
                self._keeper.start()
        self._changed.set()

    def cancel(self, key: str) -> None:
        """Drop a key and kill its process; does nothing for a key that is not there."""
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

    def close(self) -> None:
        """Kill everything; nothing is submitted afterwards."""
        with self._lock:
            self._closed = True
            started = self._keeper.is_alive()
        self._changed.set()
        if started:
            self._keeper.join()
        self._stop()

    # --- a list of jobs ---

    def run(self, jobs: Iterable[Job]) -> Generator[Finished[Job, Result] | Lost[Job]]:
        """What became of each job, as it happens; leaving the loop stops everything.

        A job that raised, died or was late is tried again, until it had ATTEMPTS.
        """
        attempts = {str(number): _Attempt(job) for number, job in enumerate(jobs)}
        try:
            for key, attempt in attempts.items():
                self.submit(key, attempt.job, self.time_limit)
            while attempts:
                yield self._outcome(self._ended.get(), attempts)
        finally:
            self.close()

    def _outcome(
        self, ended: Ended, attempts: dict[str, _Attempt[Job]]
    ) -> Finished[Job, Result] | Lost[Job]:
        attempt = attempts.pop(ended.key)
        if ended.reason is None:
            return Finished(attempt.job, cast(Result, ended.result))
        lost = Lost(attempt.job, ended.reason, attempt.number, attempt.number >= ATTEMPTS)
        if not lost.final:
            attempts[ended.key] = _Attempt(attempt.job, attempt.number + 1)
            self.submit(ended.key, attempt.job, self.time_limit)
        return lost

    # --- the engine's thread ---

    def _keep(self) -> None:
        while not self._closed:
            try:
                self._look()
            except Exception:  # the engine outlives what whoever listens does wrong
                logger.exception("The engine stumbled and goes on")
            self._changed.wait(LOOK_EVERY)

    def _look(self) -> None:
        self._changed.clear()
        with self._lock:
            works = list(self._work.items())
        for key, work in works:
            self._look_after(key, work)
        self._place()

    def _look_after(self, key: str, work: _Work[Job, Result]) -> None:
        """Ends what is done or cancelled; what its pool or its process forgot has another turn."""
        future = work.future
        if work.cancelled:
            if future:
                future.cancel()  # Pebble kills the process
            self._end(key, Ended(key, "cancelled", cancelled=True))
        elif future and future.done():
            self._take(key, work, future)
        elif future and not future.running() and monotonic() > work.placed_at + BEGIN_LIMIT:
            future.cancel()
            self._again(key, work, "no process took it")

    def _take(self, key: str, work: _Work[Job, Result], future: Future[Result]) -> None:
        error = future.exception()
        if error is None:
            self._end(key, Ended(key, None, result=future.result()))
        elif isinstance(error, BrokenProcessPool):
            self._again(key, work, "the pool broke")
        else:
            self._end(key, Ended(key, _reason(error, work.limit)))

    def _again(self, key: str, work: _Work[Job, Result], reason: str) -> None:
        work.future = None
        if work.placings >= ATTEMPTS:
            self._end(key, Ended(key, f"{reason}, {work.placings} times"))

    def _end(self, key: str, ended: Ended) -> None:
        with self._lock:
            del self._work[key]
        self._ended.put(ended)
        if self._on_ended:
            self._on_ended()

    def _place(self) -> None:
        """Hands out work, as much as there are processes, so that the rest can be cancelled."""
        with self._lock:
            works = list(self._work.values())
        if not works:
            return
        if not (self._pool and self._pool.active):
            self._mend(works)
        placed = sum(work.future is not None for work in works)
        queued = (work for work in works if work.future is None and not work.cancelled)
        for work, _ in zip(queued, range(self.workers - placed), strict=False):
            self._hand_out(work)

    def _hand_out(self, work: _Work[Job, Result]) -> None:
        assert self._pool is not None
        with contextlib.suppress(RuntimeError):  # the pool broke just now; the next look mends it
            future = self._pool.schedule(self.function, args=(work.job,), timeout=work.limit)
            work.future, work.placed_at = future, monotonic()
            work.placings += 1
            future.add_done_callback(lambda _: self._changed.set())

    def _mend(self, works: Iterable[_Work[Job, Result]]) -> None:
        """A new pool. A broken one cannot tell of work that it had not yet taken."""
        self._stop()
        for work in works:
            if work.future and not work.future.done():
                work.future.cancel()
                work.future = None
        self._pool = self._new_pool()

    def _stop(self) -> None:
        """Ends the processes all at once; Pebble alone gives them 3 s each, one by one."""
        if self._pool is None:
            return
        self._pool.stop()  # type: ignore[no-untyped-call]
        processes = list(self._pool._pool_manager.worker_manager.workers.values())
        for process in processes:
            process.terminate()
        deadline = monotonic() + GRACE
        for process in processes:
            process.join(max(0.0, deadline - monotonic()))
            process.kill()
        self._pool.join()
        self._pool = None

    def _new_pool(self) -> ProcessPool:
        limit_threads()
        return ProcessPool(
            max_workers=self.workers,
            max_tasks=self.recycle_after,
            initializer=prepare_process,
            initargs=(self.log,),
            context=multiprocessing.get_context("spawn"),
        )


def _reason(error: BaseException, limit: float) -> str:
    if isinstance(error, TimeoutError) and error.__cause__ is None:  # not the function's own
        return f"took longer than {limit:g} s"
    code = getattr(error, "exitcode", None)
    if code is not None:
        return f"its process died with {f'signal {-code}' if code < 0 else f'code {code}'}"
    return f"{type(error).__name__}: {error}"
