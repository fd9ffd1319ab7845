"""Runs an evaluation, a certification or the expert for somebody who watches standard error."""

import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

from hide_tasks.contract import EpisodeSpec, Split
from server.arguments import BadUsage
from server.progress import EVERY, Reporter, reporting
from workers.engines.processes import limit_threads, prepare_process
from workers.evaluation import Evaluation, count_cpus, evaluate, missing
from workers.policies import BadPolicy
from workers.results import Results
from workers.run_folder import FolderError
from workers.sandbox.choice import NoSandbox

if TYPE_CHECKING:
    from hide_tasks.lerobot_export import Export


def run(evaluation: Evaluation, folder: Path, workers: int | None = None) -> Results:
    """Evaluates with progress on standard error; tells how to resume what was left undone.

    Raises:
        BadUsage: the policy or the folder cannot be used; nothing was played.
        KeyboardInterrupt: the run was stopped, and its folder is in order.
    """
    with reporting() as reporter:
        try:
            results = evaluate(evaluation, folder, workers=workers, watcher=reporter)
        except (BadPolicy, FolderError, NoSandbox) as error:
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


def demonstrate(
    tasks: Sequence[str],
    folder: Path,
    *,
    split: Split = "train",
    episodes: int | None = None,
    workers: int | None = None,
) -> int:
    """Records the expert's episodes that the folder lacks; how many could not be recorded.

    Raises:
        BadUsage: the folder cannot be used.
        KeyboardInterrupt: it was stopped; what is recorded stays.
    """
    from hide_tasks.demos import DemosError, Folder

    try:
        demos = Folder.prepare(folder, tasks, split)
    except DemosError as error:
        raise BadUsage(str(error)) from None
    return _record(demos, folder, _episodes(tasks, split, episodes), workers)


def export_lerobot(
    tasks: Sequence[str],
    folder: Path,
    *,
    split: Split = "train",
    episodes: int | None = None,
    workers: int | None = None,
) -> int:
    """Records the dense expert's episodes as a data set of LeRobot; how many are left out.

    Raises:
        BadUsage: the folder cannot be used.
        KeyboardInterrupt: it was stopped; what is recorded stays.
    """
    from hide_tasks.demos import DemosError
    from hide_tasks.lerobot_export import Export

    with ExitStack() as until:
        try:
            export = until.enter_context(Export.opened(folder, tasks, split, episodes))
        except DemosError as error:
            raise BadUsage(str(error)) from None
        return _export(export, _episodes(tasks, split, episodes), workers)


def _export(export: "Export", wanted: Sequence[EpisodeSpec], workers: int | None) -> int:
    from hide_tasks.demos import DemosError

    failures = _record(export, export.path, wanted, workers)
    with reporting() as reporter:
        try:
            export.finish(wanted)
        except DemosError as error:
            failures = failures or 1
            reporter.say(str(error))
        if names := export.refused(wanted):
            reporter.say(f"{len(names)} left out of {len(wanted)}: {', '.join(names)}")
        if export.finished:
            count = len(wanted) - len(names)
            say = f"a LeRobotDataset of {count} episode{'s' * (count != 1)}"
            reporter.say(f"{export.path}: {say}")
        return len(names) or failures


def _episodes(tasks: Sequence[str], split: Split, episodes: int | None) -> list[EpisodeSpec]:
    from hide_tasks.suite import episodes as episodes_of

    return [spec for task in tasks for spec in episodes_of(task, split, episodes)]


class _Recorder(Protocol):
    """A folder that episodes are recorded into."""

    def left(self, specs: Sequence[EpisodeSpec]) -> list[EpisodeSpec]:
        """The episodes that it lacks."""

    def add(self, spec: EpisodeSpec) -> int:
        """Records one; its size in bytes."""


def _record(
    demos: _Recorder, folder: Path, wanted: Sequence[EpisodeSpec], workers: int | None
) -> int:
    """Records what a folder lacks, several at a time; how many could not be recorded."""
    left = demos.left(wanted)
    limit_threads()
    executor = ProcessPoolExecutor(
        workers or count_cpus(), multiprocessing.get_context("spawn"), _prepare
    )
    with reporting() as reporter, executor:
        to_record = f"{len(left)} demonstration{'s' * (len(left) != 1)} to record"
        reporter.say(f"{folder}: {to_record}, {len(wanted) - len(left)} there")
        try:
            return _count_failures([executor.submit(demos.add, spec) for spec in left], reporter)
        except BaseException as error:
            executor.shutdown(cancel_futures=True)
            if isinstance(error, KeyboardInterrupt):
                reporter.say(f"Stopped. The same command with --out {folder} resumes.")
            raise


def _count_failures(recorded: Sequence[Future[int]], reporter: Reporter) -> int:
    """Waits for recordings and tells of them; how many are missing at the end."""
    from hide_tasks.demos import DemosError

    began = told = monotonic()
    failures = size = 0
    for done, future in enumerate(as_completed(recorded), start=1):
        try:
            size += future.result()
        except DemosError as error:
            failures += 1
            reporter.say(str(error))
        except BrokenProcessPool:
            left = len(recorded) - done + 1
            reporter.say(f"A recording process died. The same command records the {left} left.")
            return failures + left
        if done == len(recorded) or monotonic() - told > EVERY:
            told = monotonic()
            reporter.say(_pace(done, len(recorded), told - began, size))
    return failures


def _pace(done: int, total: int, seconds: float, size: int) -> str:
    left = (total - done) * seconds / done / 60
    return (
        f"{done} of {total} demonstrations, {60 * done / seconds:.1f}/min, "
        f"{left:.0f} min left, {size / 1e6:.1f} MB"
    )


def _prepare() -> None:
    """Ctrl-C reaches every process of the terminal; these end at once and say nothing."""
    prepare_process()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
