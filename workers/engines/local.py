"""A pool of processes on this machine. It places work and kills what is late; it keeps no truth."""

import faulthandler
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from pebble import ProcessPool

Job = TypeVar("Job")
Result = TypeVar("Result")

ATTEMPTS = 3
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


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


class LocalEngine(Generic[Job, Result]):
    """Runs one function over many jobs, each in a process that can be killed.

    Args:
        function: takes a job; importable by name in a fresh interpreter.
        workers: how many processes.
        time_limit: seconds for one attempt; then its process is killed.
        log: file that takes what the processes print, native libraries and crashes included.
        recycle_after: a process is replaced after so many jobs, before what it leaks adds up.
    """

    def __init__(
        self,
        function: Callable[[Job], Result],
        *,
        workers: int,
        time_limit: float,
        log: Path = Path(os.devnull),
        recycle_after: int = 50,
    ):
        self.function = function
        self.workers = workers
        self.time_limit = time_limit
        self.log = log
        self.recycle_after = recycle_after
        self._running: dict[Future[Result], _Attempt[Job]] = {}
        self._done: SimpleQueue[Future[Result]] = SimpleQueue()
        self._pool: ProcessPool

    def run(self, jobs: Iterable[Job]) -> Generator[Finished[Job, Result] | Lost[Job]]:
        """What became of each job, as it happens; leaving the loop stops everything.

        A job that raised, died or was late is tried again, until it had ATTEMPTS.
        """
        waiting = deque(_Attempt(job) for job in jobs)
        self._pool = self._new_pool()
        try:
            while waiting or self._running:
                self._place(waiting)
                outcome = self._outcome(self._next_done())
                if isinstance(outcome, Lost) and not outcome.final:
                    waiting.append(_Attempt(outcome.job, outcome.attempt + 1))
                yield outcome
        finally:
            self._stop()

    def _place(self, waiting: deque[_Attempt[Job]]) -> None:
        """Hands out work, two jobs a process: one running, one at hand."""
        if not self._pool.active:  # a process died between two jobs; Pebble gives up then
            self._stop()
            self._pool = self._new_pool()
        while waiting and len(self._running) < 2 * self.workers:
            attempt = waiting.popleft()
            future = self._pool.schedule(
                self.function, args=(attempt.job,), timeout=self.time_limit
            )
            self._running[future] = attempt
            future.add_done_callback(self._done.put)

    def _outcome(self, future: Future[Result]) -> Finished[Job, Result] | Lost[Job]:
        attempt = self._running.pop(future)
        error = CancelledError("the pool broke") if future.cancelled() else future.exception()
        if error is None:
            return Finished(attempt.job, future.result())
        return Lost(attempt.job, self._reason(error), attempt.number, attempt.number >= ATTEMPTS)

    def _next_done(self) -> Future[Result]:
        while True:
            try:
                return self._done.get(timeout=1.0)
            except Empty:
                self._give_up_if_broken()

    def _give_up_if_broken(self) -> None:
        """Ends what a broken pool has forgotten: it cannot tell of work it had not yet taken."""
        if not self._pool.active:
            for future in list(self._running):
                future.cancel()

    def _reason(self, error: BaseException) -> str:
        if isinstance(error, TimeoutError):
            return f"took longer than {self.time_limit:g} s"
        code = getattr(error, "exitcode", None)
        if code is not None:
            return f"its process died with {f'signal {-code}' if code < 0 else f'code {code}'}"
        return f"{type(error).__name__}: {error}"

    def _stop(self) -> None:
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()

    def _new_pool(self) -> ProcessPool:
        limit_threads()
        return ProcessPool(
            max_workers=self.workers,
            max_tasks=self.recycle_after,
            initializer=prepare_process,
            initargs=(self.log,),
            context=multiprocessing.get_context("spawn"),
        )


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
