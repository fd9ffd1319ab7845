"""What the API gives out and takes in, and what the pages show: one model a noun.

Times are RFC 3339 in UTC. Rates are 0 to 1, with 95 % Wilson intervals.
"""

from datetime import datetime
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, SecretStr, StrictBool

from hide_tasks.contract import (
    Category,
    DecisionRecord,
    Failure,
    HiddenState,
    Rules,
    Split,
    Start,
    Timing,
    Value,
    Variation,
)
from hide_tasks.statistics import Rate
from server.access import Role, Scope
from server.states import AttemptState, Desired, EpisodeState, EvaluationState
from workers.protocol import NamedPolicy, PolicySpec
from workers.sandbox.choice import Sandbox

Item = TypeVar("Item")
Verdict = Literal["success", "exact"]
PolicyName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.:+-]{0,79}$")]
Description = Annotated[str, Field(max_length=2000)]


class _Given(BaseModel):
    """What a client sends: nothing unknown, nothing converted silently."""

    model_config = ConfigDict(extra="forbid")


class Page(BaseModel, Generic[Item]):
    """Some items of a list; `next` is passed back unchanged as `cursor` for more."""

    items: list[Item]
    next: str | None = None


class RatePublic(BaseModel):
    """Successes among episodes; `value` is null without episodes."""

    successes: int
    episodes: int
    value: float | None
    low: float
    high: float

    @classmethod
    def of(cls, successes: int, episodes: int) -> Self:
        """A rate with its interval."""
        rate = Rate(successes, episodes)
        low, high = rate.interval
        value = rate.value if episodes else None
        return cls(successes=successes, episodes=episodes, value=value, low=low, high=high)


class Verdicts(BaseModel):
    """Both verdicts over the same episodes."""

    success: RatePublic
    exact: RatePublic


# --- policies ---


class PolicyCreate(_Given):
    """A policy to be registered; the same name again makes its next version."""

    name: PolicyName
    description: Description = ""
    spec: NamedPolicy  # a checkpoint is uploaded


class PolicyVersionPublic(BaseModel):
    """One version of a policy; it never changes."""

    id: str
    policy: str  # its name
    version: int
    description: str
    spec: PolicySpec
    reference: bool  # a built-in policy, shown beside the ranking
    created: datetime
    owner: str | None  # name of a user; null: the server's own


class UploadMetadata(_Given):
    """What a client says of an upload when it begins."""

    name: PolicyName
    description: Description = ""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    # what tus clients add of themselves
    filename: Annotated[str, Field(max_length=500), Field(exclude=True)] = ""
    filetype: Annotated[str, Field(max_length=500), Field(exclude=True)] = ""


class UploadPublic(BaseModel):
    """How far an upload is."""

    id: str
    offset: int  # bytes that have come
    length: int
    expires: datetime


# --- evaluations ---


class EvaluationCreate(_Given):
    """An evaluation to be run."""

    policy: Annotated[str, Field(min_length=1, max_length=100)]  # name, name@version, or id
    tasks: Annotated[list[str], Field(min_length=1)] | None = None  # default: all
    category: Category | None = None  # only tasks of this kind
    split: Split = "test"
    episodes: Annotated[int, Field(ge=1, strict=True)] | None = None  # per task, the first; all
    rules: Rules = "hide"
    priority: Annotated[int, Field(ge=-100, le=100, strict=True)] = 0  # higher goes first
    recordings: StrictBool = True


class Matrix(_Given):
    """Every policy with the same evaluation."""

    policies: Annotated[list[str], Field(min_length=1, max_length=200)]
    tasks: Annotated[list[str], Field(min_length=1)] | None = None
    category: Category | None = None
    split: Split = "test"
    episodes: Annotated[int, Field(ge=1, strict=True)] | None = None
    rules: Rules = "hide"
    priority: Annotated[int, Field(ge=-100, le=100, strict=True)] = 0
    recordings: StrictBool = True


class BatchCreate(_Given):
    """Many evaluations at once: listed one by one, or a matrix."""

    items: Annotated[list[dict[str, Any]], Field(max_length=200)] = []
    matrix: Matrix | None = None


class Progress(BaseModel):
    """How far an evaluation is."""

    expected: int  # episodes
    final: int
    running: int
    per_minute: float | None  # episodes, lately
    seconds_left: float | None


class EvaluationPublic(BaseModel):
    """An evaluation as it stands."""

    id: str
    policy: str
    version: int
    policy_version: str
    reference: bool
    state: EvaluationState
    desired: Desired
    reason: str | None  # why it waits, or why it is incomplete
    suite: str  # e.g. "hide 1"
    split: Split
    rules: Rules
    tasks: list[str]
    episodes: int  # per task
    priority: int
    recordings: bool
    created: datetime
    started: datetime | None
    ended: datetime | None
    progress: Progress
    verdicts: Verdicts  # over the final episodes
    owner: str | None  # name of a user; null: the server's own
    sandboxes: list[Sandbox]  # that were around the policy's process, in its final episodes
    last_event: int  # the events after this number are not in here yet


class BatchItem(BaseModel):
    """What became of one item of a batch."""

    status: int  # as HTTP: 202, 404, 422
    evaluation: EvaluationPublic | None = None
    problem: dict[str, Any] | None = None


class Batch(BaseModel):
    """What became of every item, in the order given."""

    items: list[BatchItem]


class AttemptPublic(BaseModel):
    """One try at running a shard."""

    id: str
    task: str
    fence: int
    state: AttemptState
    reason: str | None  # why it was lost
    leased: datetime
    ended: datetime | None


# --- episodes ---


class EpisodePublic(BaseModel):
    """One episode of an evaluation; the verdicts are null until it is final."""

    id: str
    evaluation: str
    policy: str
    task: str
    category: Category
    split: Split
    index: int
    variation: Variation
    state: EpisodeState
    fence: int  # the attempt that committed it, or plays it
    instruction: str | None
    success: bool | None
    exact: bool | None
    failure: Failure | None  # null only if exact, or not final
    detail: str
    decisions: int | None
    stage: str | None  # what the world called for at the end
    scene_hash: str | None
    final_state_hash: str | None
    timing: Timing | None
    committed: datetime | None
    recording: str | None  # path of the .rrd; of a running episode it grows
    recording_removed: datetime | None  # when it was, to make room
    live: bool  # the recording is growing
    thumbnail: str | None  # path of a JPEG, 128 x 128
    sandbox: Sandbox | None  # around the policy's process; null if it had none, or not final


class EpisodeDetail(EpisodePublic):
    """One episode with what a reader wants beside it."""

    start: Start | None  # what was true before the first decision
    budget: int  # decisions
    checks: dict[str, bool]  # at the end
    previous: str | None  # id of the neighbour in the same evaluation
    next: str | None


class DecisionPublic(DecisionRecord):
    """One decision: the action, what became of it, and the hidden state after it."""


class SpanPublic(BaseModel):
    """A value that held from one moment to another."""

    kind: Literal["hidden", "stage", "belief"]
    name: str
    value: Value | list[Value]
    decision_from: int  # the decision under way when it began
    decision_to: int
    time_from: float  # simulated seconds
    time_to: float


class ChangePublic(BaseModel):
    """The hidden state from a moment on."""

    time: float
    decision: int
    stage: str
    hidden: HiddenState


class FailureGroup(BaseModel):
    """How many episodes failed in one way."""

    category: Category
    task: str
    failure: Failure
    episodes: int


# --- leaderboard and tasks ---


class CertificatePublic(BaseModel):
    """What a task's score means."""

    verdict: Literal["strong", "weak"]
    reason: str
    ceiling_success: float  # the most that a perfect policy without memory reaches
    ceiling_exact: float
    amnesiac_success: float
    amnesiac_exact: float
    episodes: int  # of the amnesiac's measurement


class AliasPublic(BaseModel):
    """Two moments that look the same and need different keyframes."""

    why: str
    hidden: list[HiddenState]  # two
    next: list[str]  # the two stages that come next
    pixels: dict[str, float]  # share of pixels that differ, per camera
    pictures: list[str]  # paths of two pictures, if they were drawn


class TaskPublic(BaseModel):
    """One task of the suite."""

    name: str
    category: Category
    instruction: str
    paraphrases: list[str]
    variations: int
    axes: dict[str, list[Value]]
    hidden_axes: list[str]
    keyframes: list[int]
    budget: int
    hidden_state: str
    failures: dict[Failure, str]  # which can occur here, and how
    certificate: CertificatePublic | None
    aliases: list[AliasPublic]
    picture: str | None  # path


class LeaderboardColumn(BaseModel):
    """A task as the leaderboard heads its column."""

    task: str
    category: Category
    certificate: CertificatePublic | None


class LeaderboardRow(BaseModel):
    """A policy's latest complete evaluation."""

    rank: int | None  # null for reference policies
    evaluation: str
    policy: str
    version: int
    reference: bool
    ended: datetime
    tasks: dict[str, Verdicts]
    categories: dict[str, Verdicts]  # RC, HSR, EPT
    overall: Verdicts


class Leaderboard(BaseModel):
    """Complete evaluations of the whole suite, best first; reference policies follow."""

    suite: str
    split: Split
    verdict: Verdict  # ranks by it
    columns: list[LeaderboardColumn]
    ceilings: dict[str, float | None]  # of the ranking verdict: per task, per category, "overall"
    rows: list[LeaderboardRow]
    unlisted: int  # evaluations of the split that are incomplete, partial, or superseded


# --- people ---


UserName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,79}$")]
Most = Annotated[int, Field(ge=0, lt=2**31, strict=True)] | None  # null: as the settings say
MostBytes = Annotated[int, Field(ge=0, lt=2**63, strict=True)] | None
Password = Annotated[SecretStr, Field(max_length=200)]


class Quota(BaseModel):
    """How much of something is used, and how much may be."""

    used: int
    limit: int | None  # null: without bound


class Quotas(BaseModel):
    """What a user may ask for; what infrastructure left incomplete is given back."""

    attempts: Quota  # evaluations in 24 hours
    scored: Quota  # of the whole suite's test split, in 30 days
    storage: Quota  # bytes of checkpoints


class Me(BaseModel):
    """Who asks."""

    name: str
    role: Role
    scopes: list[Scope]  # of what was shown; a token may have fewer than its user
    via: Literal["local", "session", "token"]
    quotas: Quotas


class TokenCreate(_Given):
    """A token to be made."""

    name: Annotated[str, Field(min_length=1, max_length=80)]
    scopes: Annotated[list[Scope], Field(min_length=1)]
    expires: AwareDatetime | None = None  # null: when it is revoked


class TokenPublic(BaseModel):
    """A token without its secret."""

    id: str
    user: str
    name: str
    scopes: list[Scope]
    created: datetime
    expires: datetime | None
    last_used: datetime | None  # to within five minutes
    revoked: datetime | None


class TokenCreated(TokenPublic):
    """A new token; its text is told this once."""

    token: str


class UserCreate(_Given):
    """A user to be added."""

    name: UserName
    role: Role
    password: Password | None = None  # null: tokens alone


class UserChange(_Given):
    """What is to be different about a user; what is left out stays."""

    role: Role = Role.VIEWER
    password: Password = SecretStr("")
    active: StrictBool = True
    attempts: Most = None
    scored: Most = None
    storage: MostBytes = None


class UserPublic(BaseModel):
    """A user as administrators see them."""

    name: str
    role: Role
    active: bool
    has_password: bool
    created: datetime
    quotas: Quotas


class AuditEntryPublic(BaseModel):
    """Something that somebody changed, or was refused."""

    model_config = ConfigDict(from_attributes=True)

    seq: int
    time: datetime
    name: str  # of the user then, or that was given to sign in
    via: str  # local, session, token and its id, command, none
    address: str
    action: str
    subject: str
    status: int  # as HTTP


class Health(BaseModel):
    """Whether the server can do its work."""

    status: Literal["ok", "degraded"]
    checks: dict[str, str]
    workers: int
    sandbox: Sandbox  # around the processes of policies on the server's machine
    running: int  # attempts
    queued: int  # shards


class ProblemDocument(BaseModel):
    """An error of the API (RFC 9457)."""

    type: str
    title: str
    status: int
    code: str  # stable, for programs
    detail: str  # for people
    errors: list[dict[str, str]] = []  # {field, message} of each field that is wrong
