"""What a process with a simulator does: play one episode, with a recording if one is wanted."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TYPE_CHECKING

from hide_tasks.contract import DecisionRecord, EpisodeResult, EpisodeSpec, Policy, Rules
from workers.fitness import lacks_camera
from workers.policies import Hosted, PolicyChoice
from workers.policy_process import PolicyDied, PolicyProcess
from workers.protocol import DEATHS
from workers.remote.target import RemoteProcess, Unreachable

if TYPE_CHECKING:
    from hide_tasks.witness import Witness
    from workers.hidden_trace import HiddenTrace
    from workers.recording import Recorder


@dataclass(frozen=True)
class EpisodeJob:
    """One episode to play, whole and small enough to be sent to another process."""

    spec: EpisodeSpec
    policy: PolicyChoice
    policy_text: str  # as it was asked for; the recording names it
    rules: Rules = "hide"
    recordings: Path | None = None  # the folder for them; None: none is made


@dataclass(frozen=True)
class PlayedEpisode:
    """An episode's verdicts and its decisions."""

    result: EpisodeResult
    decisions: list[DecisionRecord]


def play_episode(job: EpisodeJob) -> PlayedEpisode:
    """Plays an episode in this process, afresh where a signal ends the policy's.

    Raises:
        Exception: the simulator or the recording failed; a policy's failure is in the result.
    """
    deaths: list[str] = []
    while True:
        try:
            played = play_once(job, deaths=len(deaths))
        except PolicyDied as death:
            deaths.append(str(death))
        else:
            return PlayedEpisode(with_deaths(played.result, deaths), played.decisions)


def with_deaths(result: EpisodeResult, deaths: Sequence[str]) -> EpisodeResult:
    """A result that tells how the policy's process ended before, if it did."""
    if not deaths:
        return result
    times = f"{len(deaths)} time{'s' * (len(deaths) > 1)}"
    told = f"{result.detail} (the policy's process had died {times} before: {deaths[-1]})"
    return result.model_copy(update={"detail": told.strip()})


def play_once(
    job: EpisodeJob,
    trace: "HiddenTrace | None" = None,
    witnesses: Sequence["Witness"] = (),
    *,
    deaths: int = 0,
) -> PlayedEpisode:
    """Plays an episode in this process.

    Args:
        job: the episode.
        trace: follows the hidden state, if given.
        witnesses: more of them, besides the recorder.
        deaths: how often a signal has ended the policy's process in this episode.

    Raises:
        PolicyDied: it did so now, and not for the last time; nothing is kept of the episode.
        NotStarted: the policy's process cannot be started.
        Unreachable: the policy's server was not there before the episode began.
        Exception: the simulator or the recording failed; a policy's failure is in the result.
    """
    from hide_tasks.episode import play  # only a process that plays pays for the simulator

    policy = _policy(job.policy, job.spec.task)
    with contextlib.ExitStack() as stack:
        recorders = [stack.enter_context(_recorder(job))] if job.recordings else []
        traces = [trace] if trace else []
        result, decisions = play(
            job.spec,
            trace.watching(policy) if trace else policy,
            rules=job.rules,
            witnesses=[*traces, *recorders, *witnesses],
        )
    killed = policy.killed if isinstance(policy, PolicyProcess) else None
    if killed and deaths + 1 < DEATHS:
        raise PolicyDied(killed)
    if job.recordings:
        name = f"{job.recordings.name}/{recording_name(job.spec)}"
        result = result.model_copy(update={"recording": name})
    return PlayedEpisode(result, decisions)


def _recorder(job: EpisodeJob) -> "Recorder":
    from workers.recording import Recorder

    assert job.recordings is not None
    return Recorder(job.recordings / recording_name(job.spec), policy=job.policy_text)


def recording_name(spec: EpisodeSpec) -> str:
    """The file name of an episode's recording."""
    return f"{spec.name}.rrd"


_hosted: dict[Hosted, PolicyProcess] = {}


def _policy(choice: PolicyChoice, task: str) -> Policy:
    """A policy for one episode; one in a process of its own stays for the next episode.

    Raises:
        Unreachable: it is on another machine that cannot be reached now, or wants to see through
            a camera that the task does not have.
    """
    if not isinstance(choice, Hosted):
        return choice.make()
    if choice not in _hosted:
        close_policies()
        _hosted[choice] = choice.make()
        # Runs at SIGTERM as well, which atexit does not.
        Finalize(None, _hosted[choice].close, exitpriority=0)
    policy = _hosted[choice]
    policy.make_ready()
    if isinstance(policy, RemoteProcess):
        about = policy.open()
        if lacking := lacks_camera(choice.text, about.cameras, [task]):
            raise Unreachable(lacking)
    return policy


def close_policies() -> None:
    """Ends the policy processes that stayed; an edited policy, say, is loaded anew."""
    for policy in _hosted.values():
        policy.close()
    _hosted.clear()
