"""An evaluation without a server: which episodes, in which folder, and playing those not yet there.

What is on disk decides what is left to do, so the same call resumes an interrupted run.
"""

import os
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from hide_tasks import load, suite
from hide_tasks.catalogue import suite_of
from hide_tasks.contract import EpisodeResult, EpisodeSpec, Rules, Split
from hide_tasks.sources import sources_hash
from seek_model.trained import FOLDER
from workers import fitness, policies
from workers.engines.local import LocalEngine, Lost
from workers.policy_process import LOAD_LIMIT
from workers.protocol import DEATHS
from workers.remote.target import OPEN_LIMIT, About
from workers.results import Results
from workers.run_folder import RECORDINGS, RunFolder
from workers.sandbox.choice import Sandbox, chosen
from workers.simulator import EpisodeJob, play_episode

EPISODE_LIMIT = 600.0  # s of wall time for everything but the policy's answers
POLICY_LOG = "policy.log"
WORKERS_LOG = "workers.log"
LAYOUT = "layout.rbl"


@dataclass(frozen=True)
class Evaluation:
    """What is to be evaluated."""

    policy: str  # POLICY of the command line
    tasks: tuple[str, ...]
    split: Split = "test"
    episodes: int | None = None  # per task, the first so many of the split; None: all
    indices: tuple[int, ...] = ()  # these instead, of each task
    rules: Rules = "hide"
    recordings: bool = True
    policy_timeout: float = 60.0  # s for one answer of a policy in a process of its own
    sandbox: str | None = None  # around that process; None: what the environment says, or the best
    maps: Path | None = None  # a file that declares what a remote policy sees and how it acts
    trained: Path = FOLDER  # of the trained checkpoints that go by a name

    @property
    def specs(self) -> list[EpisodeSpec]:
        """Its episodes, task by task.

        Raises:
            UnknownTask: a task does not exist.
        """
        return [spec for task in self.tasks for spec in self._specs_of(task)]

    def _specs_of(self, task: str) -> list[EpisodeSpec]:
        if self.indices:
            return [suite.episode(task, self.split, index) for index in self.indices]
        return suite.episodes(task, self.split, self.episodes)

    @property
    def results(self) -> Results:
        """What its folder holds before the first episode."""
        planned = {task: len(self._specs_of(task)) for task in self.tasks}
        return Results(
            policy=self.policy,
            suite=suite_of(self.tasks[0]),
            version=suite.VERSION,
            split=self.split,
            rules=self.rules,
            tasks=list(planned),
            budgets={task: self._budget(task) for task in planned},
            sources={task: sources_hash(task) for task in planned},
            planned=planned,
            indices=list(self.indices),
        )

    def _budget(self, task: str) -> int:
        if self.rules == "hide":
            return load(task).budget()
        from hide_tasks.episode import PARITY_BUDGET

        return PARITY_BUDGET


class Watcher:
    """Whoever wants to know how an evaluation goes on; every method may be overridden."""

    def closed(self, sandbox: Sandbox) -> None:
        """The policy's process will have this around it."""

    def begun(self, folder: RunFolder, left: int) -> None:
        """The folder is open, so many episodes are left to play."""

    def finished(self, result: EpisodeResult) -> None:
        """An episode is finished and on disk."""

    def lost(self, episode: EpisodeSpec, reason: str, final: bool) -> None:
        """An attempt came to nothing; unless it was the last, the episode is tried again."""


def evaluate(
    evaluation: Evaluation,
    path: Path,
    *,
    workers: int | None = None,
    watcher: Watcher | None = None,
) -> Results:
    """Plays the episodes that the folder does not hold yet; everything that it holds then.

    Episodes that were lost three times are missing from it; another call tries them again.

    Raises:
        UnknownTask, BadPolicy, NoSandbox, FolderError: asked for what cannot be; nothing was
            played.
    """
    workers = workers or count_cpus()
    watcher = watcher or Watcher()
    policy = _policy(evaluation, path, workers)
    policy.require(evaluation.tasks)
    jobs = _jobs(evaluation, path, policy)
    about = _found(policy, evaluation.tasks)
    workers = min(workers, about.sessions if about else workers)
    remote = about.model_dump(mode="json") if about else None
    sandboxes = _sandboxes(jobs)
    known = {"checkpoint": _checkpoint(jobs), "sandboxes": sandboxes, "remote": remote}
    wanted = evaluation.results.model_copy(update=known)
    with RunFolder.opened(path, wanted) as folder:
        left = [job for job in jobs if _key(job.spec) not in folder.results.finished]
        for sandbox in sandboxes if left else []:
            watcher.closed(sandbox)
        watcher.begun(folder, len(left))
        if evaluation.recordings:
            _write_layout(folder, load(evaluation.tasks[0]).cameras)
        if left:
            _play(left, folder, min(workers, len(left)), watcher)
            folder.tidy()
        return folder.results


def count_cpus() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def missing(evaluation: Evaluation, results: Results) -> list[str]:
    """Names of the episodes that this call asked for and that are not there."""
    return [spec.name for spec in evaluation.specs if _key(spec) not in results.finished]


def _write_layout(folder: RunFolder, cameras: Sequence[str]) -> None:
    """Puts the viewer's layout beside the recordings; one serves them all."""
    from workers.recording_layout import write_layout

    write_layout(folder.recordings / LAYOUT, cameras)


def _key(spec: EpisodeSpec) -> tuple[str, int]:
    return spec.task, spec.index


def _policy(evaluation: Evaluation, path: Path, workers: int) -> policies.PolicyChoice:
    surroundings = policies.Surroundings(
        timeout=evaluation.policy_timeout,
        log=path.absolute() / POLICY_LOG,
        threads=max(1, count_cpus() // workers),
        hidden=(path.absolute(),),
    )
    policy = policies.parse(
        evaluation.policy, surroundings, evaluation.maps, folder=evaluation.trained
    )
    if isinstance(policy, policies.Hosted) and not isinstance(policy, policies.Remote):
        return policy.within(chosen(evaluation.sandbox))
    return policy


def _jobs(evaluation: Evaluation, path: Path, policy: policies.PolicyChoice) -> list[EpisodeJob]:
    """One job an episode."""
    recordings = path.absolute() / RECORDINGS if evaluation.recordings else None
    return [
        EpisodeJob(spec, policy.for_episode(spec), evaluation.policy, evaluation.rules, recordings)
        for spec in evaluation.specs
    ]


def _found(policy: policies.PolicyChoice, tasks: Sequence[str]) -> About | None:
    """What a policy's server says, if it has one, once it is certain that the policy can play."""
    if isinstance(policy, policies.Remote):
        about = policy.found()
        if lacking := fitness.lacks_camera(policy.text, about.cameras, tasks):
            raise policies.BadPolicy(lacking)
        return about
    if isinstance(policy, policies.Hosted):
        policy.check()
    return None


def _sandboxes(jobs: Sequence[EpisodeJob]) -> list[Sandbox]:
    """What is around the policy's process, if it has one."""
    hosted = [job.policy for job in jobs if isinstance(job.policy, policies.Hosted)]
    return sorted({one.surroundings.sandbox for one in hosted if one.surroundings.sandbox})


def _checkpoint(jobs: Sequence[EpisodeJob]) -> str | None:
    """SHA-256 of the file that all of them play, if they do."""
    hashes = {job.policy.sha256 for job in jobs if isinstance(job.policy, policies.Checkpoint)}
    return next(iter(hashes), None)


def _play(jobs: Sequence[EpisodeJob], folder: RunFolder, workers: int, watcher: Watcher) -> None:
    limit = max(_time_limit(job, folder.results.budgets) for job in jobs)
    log = folder.path / WORKERS_LOG
    engine = LocalEngine(play_episode, workers=workers, time_limit=limit, log=log)
    with closing(engine.run(jobs)) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome, Lost):
                watcher.lost(outcome.job.spec, outcome.reason, outcome.final)
            else:
                folder.commit(outcome.result.result, outcome.result.decisions)
                watcher.finished(outcome.result.result)


def _time_limit(job: EpisodeJob, budgets: dict[str, int]) -> float:
    """Seconds after which an episode hangs; a slow policy is not to blame for that."""
    if not isinstance(job.policy, policies.Hosted):
        return EPISODE_LIMIT
    answers = budgets[job.spec.task] + 1  # and the reset
    begin = LOAD_LIMIT
    if isinstance(job.policy, policies.Remote):
        begin = OPEN_LIMIT + job.policy.first_timeout
    return DEATHS * (EPISODE_LIMIT + begin + answers * job.policy.surroundings.timeout)
