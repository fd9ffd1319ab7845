"""The scheduler of a Dask cluster, set as our engine wants it."""

import asyncio
from typing import Any

ONCE = {
    "distributed.scheduler.allowed-failures": 0,  # a job that lost its machine is not run again
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.http.routes": [],  # nothing is told over HTTP
    "distributed.worker.http.routes": [],
    "distributed.admin.tick.limit": "30s",  # not every pause is worth a warning
}
SILENCE = 60.0  # s after which a machine of which nothing is heard is lost
NOWHERE = "127.0.0.1:0"  # where Dask's HTTP server, which cannot be left out, says nothing


async def schedule(
    host: str,
    port: int,
    *,
    security: Any = None,
    silence: float = SILENCE,
    ready: "asyncio.Future[str] | None" = None,
) -> None:
    """Runs a scheduler until this is cancelled.

    Args:
        silence: seconds after which a machine of which nothing is heard is lost.
        ready: told the scheduler's address.

    Raises:
        OSError: the port cannot be used.
    """
    import dask.config
    from distributed import Scheduler

    protocol = "tls" if security else "tcp"
    with dask.config.set({**ONCE, "distributed.scheduler.worker-ttl": silence}):
        async with Scheduler(
            host=host,
            port=port,
            protocol=protocol,
            security=security,
            dashboard=False,
            dashboard_address=NOWHERE,
        ) as scheduler:
            if ready:
                ready.set_result(scheduler.address)
            await scheduler.finished()
