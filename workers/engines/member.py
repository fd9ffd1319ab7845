"""A machine of a Dask cluster: takes jobs from the scheduler and runs each in a process.

Dask neither kills code that runs nor outlives a task that crashes; so what runs here is the local
engine, and Dask's task only waits for it. Whatever ends the task, a cancellation, a lost scheduler,
the end of this program, kills the processes.
"""

import asyncio
import importlib
import logging
import os
import tempfile
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from workers.engines.engine import Ended
from workers.engines.local import LocalEngine
from workers.engines.scheduler import NOWHERE, ONCE
from workers.protocol import PythonPolicy, ShardJob

logger = logging.getLogger(__name__)

LOOK_EVERY = 0.5  # s between two looks whether a job is still wanted
PATIENCE = 30  # s that a scheduler may take to answer
SERVER, SANDBOX = "HIDE_WORKER_SERVER", "HIDE_WORKER_SANDBOX"  # in the environment of processes


class JobLost(Exception):
    """A job came to nothing, through no fault of a policy; the message says why."""


class Pool:
    """The processes of this machine, for as many threads of Dask as there are."""

    def __init__(self, slots: int, log: Path):
        self._ended: dict[str, Ended] = {}
        self._changed = threading.Condition()
        self._engine: LocalEngine[tuple[str, Any], None] = LocalEngine(
            call, workers=slots, log=log, on_ended=self._collect
        )

    def run(self, key: str, job: tuple[str, Any], limit: float, wanted: Callable[[], bool]) -> None:
        """Returns when the job is done; kills it when it is not wanted any more.

        Raises:
            JobLost: it came to nothing.
        """
        self._engine.submit(key, job, limit)
        with self._changed:
            while key not in self._ended:
                if not wanted():
                    self._engine.cancel(key)
                self._changed.wait(LOOK_EVERY)
            ended = self._ended.pop(key)
        if ended.reason is not None:
            raise JobLost(ended.reason)

    def _collect(self) -> None:
        with self._changed:
            self._ended |= {one.key: one for one in self._engine.ended()}
            self._changed.notify_all()

    def close(self) -> None:
        """Kills everything."""
        self._engine.close()


_pool: Pool | None = None  # of this process, while it is a member


def run_here(function: str, job: Any, limit: float) -> None:
    """Dask's task: a job, run in a process of this machine.

    Raises:
        JobLost: it came to nothing.
    """
    from distributed import Status, get_worker

    worker = get_worker()
    key = str(worker.get_current_task())

    def wanted() -> bool:
        task = worker.state.tasks.get(key)
        executing = task is not None and task.state in ("executing", "long-running")
        return executing and worker.status == Status.running

    if _pool is None:
        raise JobLost("this machine is about to leave the cluster")
    _pool.run(key, (function, job), limit, wanted)


def call(job: tuple[str, Any]) -> None:
    """In a process of the pool: calls a function by its name, module:function."""
    module, _, name = job[0].partition(":")
    getattr(importlib.import_module(module), name)(job[1])


def play(document: dict[str, Any]) -> None:
    """A shard, for the server and in the sandbox that this machine was told.

    Raises:
        JobLost: the policy is a class of another machine.
    """
    from workers.supervisor import run_shard

    job = ShardJob.model_validate(document)
    policy = job.policy
    if isinstance(policy, PythonPolicy) and policy.file_hash() != policy.sha256:
        raise JobLost(f"{policy.target} is not on this machine as it was registered")
    here = {"server": os.environ[SERVER], "sandbox": os.environ.get(SANDBOX)}
    run_shard(job.model_copy(update=here))


async def take_part(
    scheduler: str, *, slots: int, log: Path, security: Any = None, name: str | None = None
) -> None:
    """Runs jobs until the scheduler is lost or this is cancelled; then nothing of them is left.

    Raises:
        OSError, TimeoutError: the scheduler does not answer.
    """
    import dask.config
    from distributed import Worker

    global _pool
    with (
        dask.config.set(ONCE),
        closing(Pool(slots, log)) as _pool,
        tempfile.TemporaryDirectory() as folder,
    ):
        try:
            async with Worker(
                scheduler,
                nthreads=slots,
                name=name,
                security=security,
                memory_limit=0,  # the processes below have limits of their own
                local_directory=folder,
                death_timeout=PATIENCE,
                dashboard_address=NOWHERE,
            ) as worker:
                await worker.finished()
        finally:
            pool, _pool = _pool, None
            await asyncio.to_thread(pool.close)
