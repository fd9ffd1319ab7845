"""What an engine runs for one attempt: the episodes of a shard, each played, sent and committed.

The simulator and the policy live in processes below this one, so nothing that they do wedges it;
here are neither torch nor PyBullet. An episode that cannot be played is a fault of its own, and
the shard goes on.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from workers import checkpoint_cache
from workers.ledger_client import (
    AlreadyFinal,
    Dropped,
    GrowingFile,
    LedgerClient,
    LedgerError,
    Refused,
    Stale,
)
from workers.policy_process import PolicyDied
from workers.protocol import (
    AssignedEpisode,
    CheckpointPolicy,
    EpisodeCommit,
    HostedPolicy,
    ShardJob,
    Stored,
)
from workers.sandbox.choice import chosen
from workers.sandbox.launch import SCRATCH
from workers.simulator import recording_name, with_deaths
from workers.simulator_process import Play, SimulatorFailure, SimulatorProcess

LAST_WORD = 5.0  # s that an upload which nobody wants may take to notice

# Warm between the shards of one process of the engine.
simulator = SimulatorProcess()


class ShardFailure(Exception):
    """Some episodes of a shard could not be played."""


class Mismatch(Exception):
    """The server keeps other bytes than the recording has."""


def run_shard(job: ShardJob) -> None:
    """Plays and commits every episode of a shard; an attempt that is not current just ends.

    Raises:
        ShardFailure: some episodes could not be played; the server knows which and why.
        LedgerError: the server does not take reports, or does not give the checkpoint.
        WrongContent: the checkpoint that it gives is another one.
        NoSandbox: the sandbox that it asks for cannot be had here.
    """
    with scratch_folder() as scratch, LedgerClient(job.server, job.attempt, job.token) as ledger:
        try:
            with _checkpoint(job, ledger) as checkpoint:
                faults = _run_episodes(job, ledger, scratch, checkpoint)
        except Stale:
            simulator.close()
            return
        except BaseException:
            simulator.close()
            raise
        simulator.rest()
    if faults:
        raise ShardFailure(
            f"{len(faults)} of {len(job.episodes)} episodes could not be played: {faults[0]}"
        )


@contextlib.contextmanager
def _checkpoint(job: ShardJob, ledger: LedgerClient) -> Iterator[Path | None]:
    """The file of a policy that is a checkpoint; a file that is not here yet is fetched."""
    if not isinstance(job.policy, CheckpointPolicy):
        yield None
        return
    with checkpoint_cache.held(job.policy.sha256, ledger.fetch_checkpoint) as path:
        yield path


def _run_episodes(
    job: ShardJob, ledger: LedgerClient, scratch: Path, checkpoint: Path | None
) -> list[str]:
    """Why episodes could not be played, each in one sentence."""
    faults = []
    for episode in job.episodes:
        try:
            ledger.start(episode.id)
        except AlreadyFinal:  # the engine placed this job again
            continue
        try:
            commit = _play(job, episode, ledger, scratch, checkpoint)
            ledger.commit(episode.id, commit)
        except (SimulatorFailure, Refused, Mismatch) as error:
            ledger.fault(episode.id, str(error))
            faults.append(f"{episode.spec.name}: {error}")
    return faults


def _play(
    job: ShardJob,
    episode: AssignedEpisode,
    ledger: LedgerClient,
    scratch: Path,
    checkpoint: Path | None,
) -> EpisodeCommit:
    """A finished episode whose recording the server has; afresh where the policy's process died."""
    sandbox = chosen(job.sandbox) if isinstance(job.policy, HostedPolicy) else None
    deaths: list[str] = []
    while True:
        request = Play(
            episode=episode,
            policy=job.policy,
            checkpoint=checkpoint,
            policy_name=job.policy_name,
            rules=job.rules,
            sources=job.sources,
            sandbox=sandbox,
            hidden=job.hidden,
            deaths=len(deaths),
            allowed=job.allowed,
        )
        try:
            commit = _play_once(job, request, ledger, scratch)
        except PolicyDied as death:
            deaths.append(str(death))
        else:
            return commit.model_copy(update={"result": with_deaths(commit.result, deaths)})


def _play_once(job: ShardJob, request: Play, ledger: LedgerClient, scratch: Path) -> EpisodeCommit:
    if not job.recordings:
        return simulator.play(request, limit=job.episode_limit)
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        request = request.model_copy(update={"recordings": Path(folder)})
        episode = request.episode
        with Upload(ledger, episode.id, Path(folder) / recording_name(episode.spec)) as upload:
            try:
                commit = simulator.play(request, limit=job.episode_limit)
            except (SimulatorFailure, PolicyDied):
                upload.raise_if_stale()
                raise
            return commit.model_copy(update={"recording": upload.stored().sha256})


class Upload:
    """A recording on its way to the server while it is written; a context that drops the rest."""

    def __init__(self, ledger: LedgerClient, episode: str, path: Path):
        self._ledger, self._episode = ledger, episode
        self._file = GrowingFile(path)
        self._answer: Stored | None = None
        self._error: Exception | None = None
        self._wanted = True
        self._thread = threading.Thread(target=self._send, name="upload", daemon=True)
        self._thread.start()

    def stored(self) -> Stored:
        """What the server keeps, once the recording is written.

        Raises:
            LedgerError, Mismatch: the server does not have it.
        """
        self._file.finish()
        self._thread.join()
        if self._error:
            raise self._error
        assert self._answer is not None
        with self._file.path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        if self._answer.sha256 != sha256:
            raise Mismatch(
                f"The server keeps {self._answer.size} bytes with SHA-256 {self._answer.sha256}; "
                f"the recording has {self._file.path.stat().st_size} bytes with {sha256}."
            )
        return self._answer

    def raise_if_stale(self) -> None:
        """Does nothing unless the server said so.

        Raises:
            Stale: another attempt is the current one.
        """
        if isinstance(self._error, Stale):
            raise self._error

    def _send(self) -> None:
        try:
            self._answer = self._ledger.upload_recording(self._episode, self._file)
        except Dropped:
            pass
        except (LedgerError, OSError, ValueError) as error:
            self._error = error
            if isinstance(error, Stale) and self._wanted:
                simulator.kill()  # so that nothing waits for its end

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._wanted = False
        self._file.drop()
        self._thread.join(LAST_WORD)


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder for growing recordings, in TMPDIR; removes what killed processes left there."""
    place = Path(tempfile.gettempdir())
    for left in place.glob(f"{SCRATCH}*"):
        if not _alive(left.name.removeprefix(SCRATCH).partition("-")[0]):
            shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=f"{SCRATCH}{os.getpid()}-", dir=place) as folder:
        yield Path(folder)


def _alive(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return False
    except (ValueError, PermissionError):
        pass  # not ours to judge
    return True
