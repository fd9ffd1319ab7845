"""The process in which episodes are simulated; started as `python -m workers.simulator_host FD`.

It is told {"play": Play} or {"rest": {}}, which ends the policy's process. Of an episode it tells
{"decided": n} as it goes on, then {"played": EpisodeCommit}, {"failed": reason} or, if a signal
ended the policy's process, {"died": signal}. It ends at once with the process that started it.
"""

import os
import socket
import stat
import sys
import threading
import traceback
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.scene import Part
from hide_tasks.contract import DecisionRecord, EpisodeResult, EpisodeSpec, Observation, Start
from hide_tasks.machine import fingerprint
from hide_tasks.sources import sources_hash
from workers import policies, wire
from workers.hidden_trace import HiddenTrace
from workers.policy_host import die_with_parent
from workers.policy_process import PolicyDied
from workers.protocol import (
    BuiltInPolicy,
    CheckpointPolicy,
    EpisodeCommit,
    PythonPolicy,
    RemotePolicy,
    measured_digest,
)
from workers.simulator import EpisodeJob, close_policies, play_once
from workers.simulator_process import Play


class Progress:
    """A witness that tells the supervisor how many decisions were made."""

    def __init__(self, connection: socket.socket):
        self.connection = connection

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence[Part], start: Start
    ) -> None:
        """None yet."""
        wire.send(self.connection, {"decided": 0})

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Frames are not told."""

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """One more."""
        wire.send(self.connection, {"decided": record.decision + 1})

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """The result is told by whoever plays."""


def play(request: Play, connection: socket.socket) -> EpisodeCommit:
    """The finished episode, but for its recording's hash.

    Raises:
        OtherSources: this process would play it by other code than the rest of its evaluation.
        PolicyDied: a signal ended the policy's process, not for the last time.
        Exception: the simulator or the recording failed; a policy's failure is in the result.
    """
    _require_sources(request.episode.spec.task, request.sources)
    job = EpisodeJob(
        request.episode.spec,
        choice(request),
        request.policy_name,
        request.rules,
        request.recordings,
    )
    trace = HiddenTrace()
    played = play_once(job, trace, [Progress(connection)], deaths=request.deaths)
    result = played.result.model_copy(update={"recording": None})
    measured = (result, trace.start, tuple(played.decisions), tuple(trace.changes))
    return EpisodeCommit(
        result=result,
        start=trace.start,
        decisions=measured[2],
        changes=measured[3],
        thumbnail=trace.thumbnail,
        sandbox=request.sandbox,
        machine=fingerprint(),
        digest=measured_digest(*measured),
    )


class OtherSources(Exception):
    """The code on the disk has changed since the server was started."""


def _require_sources(task: str, wanted: str | None) -> None:
    if wanted is not None and sources_of(task) != wanted:
        raise OtherSources(f"the sources of {task} changed; start the server anew")


@cache
def sources_of(task: str) -> str:
    """The hash of the code that this process plays a task by; read once, as the code is."""
    return sources_hash(task)


def choice(request: Play) -> policies.PolicyChoice:
    """The policy that a request names.

    Raises:
        ValueError: a replay came without its actions, a checkpoint without its file, or a remote
            policy with an address that is none.
    """
    policy = request.policy
    if isinstance(policy, BuiltInPolicy):
        return policies.BuiltIn(policy.name)
    if isinstance(policy, PythonPolicy):
        return policies.Hosted(policy.target, _surroundings(request, policy.timeout))
    if isinstance(policy, CheckpointPolicy):
        if request.checkpoint is None:
            raise ValueError(f"{request.policy_name} came without the file of its checkpoint.")
        surroundings = _surroundings(request, policy.timeout)
        return policies.Checkpoint.of_file(request.checkpoint, policy.sha256, surroundings)
    if isinstance(policy, RemotePolicy):
        surroundings = policies.Surroundings(log=_log(), threads=1)
        return policies.Remote.of_spec(policy, request.allowed, surroundings)
    if request.episode.actions is None:
        raise ValueError(
            f"{request.episode.spec.name} came without actions; a replay needs them with each "
            "episode."
        )
    return policies.Actions(request.episode.actions)


def _surroundings(request: Play, timeout: float) -> policies.Surroundings:
    return policies.Surroundings(timeout, _log(), 1, request.sandbox, request.hidden)


def _log() -> Path | None:
    """The file that this process prints to, if it is one; a policy prints there, too."""
    try:
        path = Path(f"/proc/self/fd/{sys.stderr.fileno()}").readlink()
        return path if stat.S_ISREG(path.stat().st_mode) else None
    except OSError:
        return None


def serve(connection: socket.socket) -> None:
    """Plays what is asked for, for ever; the thread that reads ends the process."""
    requests: SimpleQueue[dict[str, Any]] = SimpleQueue()
    threading.Thread(target=_read, args=(connection, requests), daemon=True).start()
    while True:
        [(kind, content)] = requests.get().items()
        if kind == "rest":
            close_policies()
        else:
            wire.send(connection, answer(content, connection))


def answer(content: dict[str, Any], connection: socket.socket) -> dict[str, Any]:
    """What came of a request to play; a simulator's exception is a reply, too."""
    try:
        played = play(Play.model_validate(content), connection)
        return {"played": played.model_dump(mode="json")}
    except PolicyDied as death:
        return {"died": str(death)}
    except Exception as error:
        traceback.print_exc()
        return {"failed": "".join(traceback.format_exception_only(error)).strip()}


def _read(connection: socket.socket, requests: SimpleQueue[dict[str, Any]]) -> None:
    try:
        while True:
            requests.put(wire.receive(connection))
    except (OSError, EOFError, wire.WireError):
        os._exit(1)  # the supervisor is gone, whatever the simulator is doing


def main() -> None:
    """Serve on the socket whose number is the only argument."""
    die_with_parent()
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        serve(connection)


if __name__ == "__main__":
    main()
