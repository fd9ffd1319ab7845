"""What travels between the server and the workers of an evaluation: a shard, and what came of it.

A worker never opens the ledger. It is handed a ShardJob by an engine and reports by HTTP, with the
token of its attempt:

    POST {server}/internal/v1/attempts/{attempt}/episodes/{episode}/start       begun
    PUT  …/episodes/{episode}/recording    the growing .rrd, chunked            Stored
    PUT  …/episodes/{episode}/result       EpisodeCommit                        Committed
    POST …/episodes/{episode}/fault        Fault: the infrastructure failed, not the policy
    GET  …/checkpoint                      the policy's file, if its policy is one

409 says that the attempt is no longer the current one, and the worker drops the shard; with the
code `episode_final` it says that the episode is committed, and the worker goes on with the next.
"""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Base64Bytes, BaseModel, ConfigDict, Field, model_validator

from hide_tasks.contract import (
    Action,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    HiddenState,
    Rules,
    Start,
)
from workers.remote.maps import ActionMap, ObservationMap, require_free_names
from workers.remote.wires import SCHEMES, STATELESS, Dialect, Wire
from workers.sandbox.choice import Sandbox

INTERNAL = "/internal/v1"
EPISODE_FINAL = "episode_final"
SHARD_SIZE = 5  # episodes of one task
DEATHS = 3  # of the policy's process, by a signal, in one episode: then they are its failure

UNMEASURED = {"timing", "recording", "detail"}  # of a result: no part of its digest

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Timeout = Annotated[float, Field(gt=0, le=3600)]  # s for one answer


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class BuiltInPolicy(_Message):
    """A policy of hide_tasks; it runs inside the simulator's process."""

    kind: Literal["builtin"] = "builtin"
    name: Literal["expert", "amnesiac", "random", "noop"]


class PythonPolicy(_Message):
    """A class on the worker's machine, in a process of its own."""

    kind: Literal["python"] = "python"
    target: str  # module:Class or path/to/file.py:Class
    timeout: Timeout = 60.0
    sha256: Sha256 | None = None  # at registration

    def file_hash(self) -> str | None:
        """SHA-256 of the file that it names now; None for a module or if there is none."""
        path = Path(self.target.rpartition(":")[0])
        if path.suffix != ".py" or not path.is_file():
            return None
        return hashlib.sha256(path.read_bytes()).hexdigest()


class CheckpointPolicy(_Message):
    """A file of weights that the server keeps; nothing of it is executed."""

    kind: Literal["checkpoint"] = "checkpoint"
    sha256: Sha256
    size: Annotated[int, Field(ge=0)]  # bytes
    model: Annotated[str, Field(max_length=100)] = ""  # the name of its configuration
    suite: Annotated[str, Field(max_length=100)] = "hide"  # of its demonstrations
    timeout: Timeout = 60.0


class ReplayPolicy(_Message):
    """The recorded actions of another evaluation, told with each episode."""

    kind: Literal["replay"] = "replay"
    evaluation: str


class RemotePolicy(_Message):
    """A policy that somebody serves; a worker connects to it, from a process of its own."""

    kind: Literal["remote"] = "remote"
    url: Annotated[str, Field(max_length=500)]
    wire: Wire = "openpi"
    dialect: Dialect | None = None  # None: what the server speaks; said at registration
    observation: ObservationMap | None = None  # None: as a server of our dialect declares it
    action: ActionMap | None = None
    timeout: Timeout = 60.0
    first_timeout: Timeout = 120.0  # s for an episode's first answer: some compile then
    concurrency: Annotated[int, Field(ge=1, le=64)] | None = None  # episodes at a time
    model: Annotated[str, Field(max_length=100)] = ""  # as the server calls it, at registration

    @property
    def stateless_transport(self) -> bool:
        """True if nothing but a new connection tells the policy of a new episode."""
        return self.dialect in STATELESS

    @property
    def schemes(self) -> tuple[str, ...]:
        """What its URL may begin with."""
        return SCHEMES[self.wire]

    @model_validator(mode="after")
    def _maps_are_whole(self) -> Self:
        if (self.observation is None) != (self.action is None):
            raise ValueError("observation and action are declared together, or by the server")
        if self.observation is None and self.wire != "openpi":
            raise ValueError(
                f"a server of {self.wire} does not say what it wants to see; declare observation "
                "and action"
            )
        if self.wire != "openpi" and self.dialect not in (None, self.wire):
            raise ValueError(f"{self.dialect} is a dialect of openpi, not of {self.wire}")
        if self.observation is not None:
            require_free_names(self.observation)
        return self


HostedPolicy = PythonPolicy | CheckpointPolicy | RemotePolicy  # in a process of its own
NamedPolicy = Annotated[
    BuiltInPolicy | PythonPolicy | ReplayPolicy | RemotePolicy, Field(discriminator="kind")
]
PolicySpec = Annotated[
    BuiltInPolicy | PythonPolicy | ReplayPolicy | CheckpointPolicy | RemotePolicy,
    Field(discriminator="kind"),
]


class AssignedEpisode(_Message):
    """An episode that is to be played."""

    id: str
    spec: EpisodeSpec
    actions: tuple[Action, ...] | None = None  # what a replay repeats


class ShardJob(_Message):
    """The episodes of one shard that are not final yet, for one attempt."""

    attempt: str
    token: str  # of this attempt alone
    server: str  # e.g. http://127.0.0.1:8000
    policy: PolicySpec
    policy_name: str  # as recordings name it
    rules: Rules = "hide"
    recordings: bool = True
    sources: str | None = None  # hash of the code that must play it; None: whatever is there
    allowed: tuple[str, ...] = ()  # where else than on the internet a remote policy may be
    episode_limit: float  # s of wall time for one episode
    sandbox: str | None = None  # around the policy's process; None: the worker chooses
    hidden: tuple[Path, ...] = ()  # folders that no policy may see, on the server's machine
    episodes: tuple[AssignedEpisode, ...]

    @property
    def limit(self) -> float:
        """Seconds of wall time after which the whole attempt hangs."""
        tries = DEATHS if isinstance(self.policy, HostedPolicy) else 1
        return 120.0 + self.episode_limit * tries * len(self.episodes)


class HiddenChange(_Message):
    """The hidden state from a moment on; looked at 20 times a simulated second."""

    time: float  # simulated seconds
    decision: int  # the decision under way; 0 at the start
    stage: str
    hidden: HiddenState


class EpisodeCommit(_Message):
    """A finished episode: everything that was measured."""

    result: EpisodeResult
    start: Start
    decisions: tuple[DecisionRecord, ...]
    changes: tuple[HiddenChange, ...]  # the first is the start
    recording: str | None = None  # SHA-256 of the .rrd that was sent before
    thumbnail: Base64Bytes | None = None  # JPEG, what the front camera saw last
    sandbox: Sandbox | None = None  # around the policy's process; None: it had no process
    machine: dict[str, str] | None = None  # fingerprint of the one that played it
    digest: str  # measured_digest of what was measured


class Stored(_Message):
    """What the server keeps of a recording."""

    sha256: str
    size: int  # bytes


class Committed(_Message):
    """The episode is in the ledger; `already` if it was there before."""

    already: bool


class Fault(_Message):
    """Why an episode could not be played, through no fault of a policy."""

    reason: Annotated[str, Field(max_length=2000)]


def measured_digest(
    result: EpisodeResult,
    start: Start,
    decisions: tuple[DecisionRecord, ...],
    changes: tuple[HiddenChange, ...],
) -> str:
    """SHA-256 of what was measured: the same twice if, and only if, the episode went the same way.

    What the machine's clock said does not count, nor does the recording.
    """
    return digest_of_documents(
        result.model_dump(mode="json", exclude=UNMEASURED),
        start.model_dump(mode="json"),
        [decision.model_dump(mode="json") for decision in decisions],
        [change.model_dump(mode="json") for change in changes],
    )


def digest_of_documents(
    result: dict[str, Any], start: Any, decisions: list[Any], changes: list[Any]
) -> str:
    """The same of documents as a ledger keeps them, without what newer versions know besides."""
    content = {"result": result, "start": start, "decisions": decisions, "changes": changes}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
