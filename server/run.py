"""Runs an evaluation or a certification for somebody who watches standard error."""

import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from server.arguments import BadUsage
from server.progress import reporting
from workers.engines.processes import limit_threads, prepare_process
from workers.evaluation import Evaluation, count_cpus, evaluate, missing
from workers.policies import BadPolicy
from workers.results import Results
from workers.run_folder import FolderError


def run(evaluation: Evaluation, folder: Path, workers: int | None = None) -> Results:
    """Evaluates with progress on standard error; tells how to resume what was left undone.

    Raises:
        BadUsage: the policy or the folder cannot be used; nothing was played.
        KeyboardInterrupt: the run was stopped, and its folder is in order.
    """
    with reporting() as reporter:
        try:
            results = evaluate(evaluation, folder, workers=workers, watcher=reporter)
        except (BadPolicy, FolderError) as error:
            raise BadUsage(str(error)) from None
        except KeyboardInterrupt:
            reporter.say(f"Stopped. The same command with --out {folder} resumes.")
            raise
        if names := missing(evaluation, results):
            reporter.say(
                f"Missing, because they could not be played: {', '.join(names)}. "
                f"The same command with --out {folder} tries them again."
            )
        return results


def recertify(tasks: Sequence[str], workers: int | None = None) -> list[dict[str, Any]]:
    """The new certificates of tasks, which are also written into the package."""
    from hide_tasks.certificate import certify

    limit_threads()
    context = multiprocessing.get_context("spawn")
    certificates = []
    with (
        reporting() as reporter,
        ProcessPoolExecutor(workers or count_cpus(), context, _prepare) as executor,
    ):
        for task in tasks:
            certificates.append(certify(task, executor))
            reporter.say(f"{task}: {certificates[-1]['verdict']}. {certificates[-1]['reason']}")
    return certificates


def _prepare() -> None:
    """Ctrl-C reaches every process of the terminal; these end at once and say nothing."""
    prepare_process()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
