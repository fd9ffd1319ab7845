"""What an engine may run in place of a supervisor; imported by name in its processes."""

import time

from workers.protocol import ShardJob


def returns(_: ShardJob) -> None:
    """Comes to its end and has committed nothing."""


def raises(job: ShardJob) -> None:
    raise RuntimeError(f"no simulator for {job.episodes[0].spec.task}")


def hangs(_: ShardJob) -> None:
    time.sleep(600)
