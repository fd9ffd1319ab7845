"""What the API gives out and takes in, and what the pages show: one model a noun.

Times are RFC 3339 in UTC. Rates are 0 to 1, with 95 % Wilson intervals.
"""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

from pydantic import (
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SecretStr,
    StrictBool,
)
from pydantic_core import PydanticCustomError

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
from server.states import (
    AttemptState,
    DeliveryState,
    Desired,
    EpisodeState,
    EvaluationState,
    WebhookEvent,
)
from workers.preflight import Check
from workers.protocol import NamedPolicy, PolicySpec, RemotePolicy
from workers.remote.target import About
from workers.remote.trial import Step
from workers.sandbox.choice import Sandbox

Item = TypeVar("Item")
Verdict = Literal["success", "exact"]
PolicyName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.:+-]{0,79}$")]
Description = Annotated[str, Field(max_length=2000)]
SuiteName = Literal["smoke", "RC", "HSR", "EPT", "full"]
Component = Literal["SCM", "WCM", "PAM"]
Covers = Literal["smoke", "RC", "HSR", "EPT", "full", "part"]


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


class PolicyDeclared(_Given):
    """What whoever registers a policy says of its memory; nobody checks it."""

    memory: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.:+-]{0,39}$")] | None = None
    clock: StrictBool | None = None  # it is told the number of the decision
    privileged: StrictBool | None = None  # it knows more than the cameras show


class PolicyCreate(_Given):
    """A policy to be registered; the same name again makes its next version."""

    name: PolicyName
    description: Description = ""
    spec: NamedPolicy  # a checkpoint is uploaded
    declared: PolicyDeclared | None = None


class PolicyFacts(BaseModel):
    """What is known of a policy's memory; null where nothing is."""

    source: Literal["built-in", "checkpoint", "declared", "unknown"]
    memory: str  # what it remembers with: "SCM+WCM+PAM", "none", as declared, or "undeclared"
    components: list[Component] = []  # of SEEK's memory
    window: int | None = None  # entries of WCM
    content: Literal["visual", "proprioception"] | None = None  # what the entries hold
    clock: bool | None = None  # it is told the number of the decision
    privileged: bool | None = None  # it knows more than the cameras show
    preset: str = ""  # the name of a checkpoint's configuration


class ConnectionCreate(_Given):
    """A policy's server to be tried; nothing is registered."""

    spec: RemotePolicy


class ConnectionPublic(BaseModel):
    """What a policy's server answered."""

    fits: bool  # it can be registered; a decision that failed does not hinder that
    about: About | None  # null: it was not reached
    steps: list[Step]  # what was tried, in order; the last may have failed


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
    checks: list[Check]  # what was tried of it when it came
    facts: PolicyFacts
    smoke: str | None  # the evaluation that tried it then, of one episode a category


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
    name: str  # of the policy
    sha256: str | None  # that the client says the file has
    offset: int  # bytes that have come
    length: int
    expires: datetime


# --- evaluations ---


def _some_tasks(value: Any) -> Any:
    if value == []:
        raise PydanticCustomError("too_short", "choose at least one task")
    return value


Tasks = Annotated[list[str], Field(min_length=1), BeforeValidator(_some_tasks)]


class EvaluationCreate(_Given):
    """An evaluation to be run."""

    policy: Annotated[str, Field(min_length=1, max_length=100)]  # name, name@version, or id
    tasks: Tasks | None = None  # default: all
    category: Category | None = None  # only tasks of this kind
    suite: SuiteName | None = None  # instead of tasks, category and episodes
    split: Split = "test"  # of `smoke`: val
    episodes: Annotated[int, Field(ge=1, strict=True)] | None = None  # per task, the first; all
    rules: Rules = "hide"
    priority: Annotated[int, Field(ge=-100, le=100, strict=True)] = 0  # higher goes first
    recordings: StrictBool = True


class EstimateQuery(EvaluationCreate):
    """An evaluation as a query asks for it, where everything is text."""

    episodes: Annotated[int, Field(ge=1)] | None = None
    priority: Annotated[int, Field(ge=-100, le=100)] = 0
    recordings: bool = True


class Matrix(_Given):
    """Every policy with the same evaluation, or with each of some suites."""

    policies: Annotated[list[str], Field(min_length=1, max_length=200)]
    suites: Annotated[list[SuiteName], Field(min_length=1, max_length=5)] | None = None
    tasks: Tasks | None = None
    category: Category | None = None
    split: Split = "test"
    episodes: Annotated[int, Field(ge=1, strict=True)] | None = None
    rules: Rules = "hide"
    priority: Annotated[int, Field(ge=-100, le=100, strict=True)] = 0
    recordings: StrictBool = True


class BatchCreate(_Given):
    """Many evaluations at once, 200 at most: listed one by one, or a matrix."""

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
    covers: Covers  # the suite that these are the whole of
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


class EstimatePublic(BaseModel):
    """What an evaluation would cost, and what goes before it; nothing was registered."""

    policy: str
    version: int
    tasks: list[str]
    episodes: int  # of all tasks
    shards: int
    covers: Covers
    ranked: bool  # it would enter the leaderboard once it is completed
    workers: int  # shards that are played for it at a time
    per_minute: float | None  # episodes; null: there are no workers
    seconds: float | None  # to play it, once it is begun
    basis: Literal["policy", "kind", "others", "assumed"]  # the weakest of what its pace is from
    basis_detail: str  # the same in a sentence
    evaluations_before: int  # that wait with its priority or a higher one
    shards_before: int
    seconds_before: float | None  # by which those before it, and beside it, make it later
    quotas: "Quotas"
    refused: str | None  # why it would be refused: a quota is used up


class BatchItem(BaseModel):
    """What became of one item of a batch."""

    status: int  # as HTTP: 202, 404, 422
    evaluation: EvaluationPublic | None = None
    problem: dict[str, Any] | None = None


class BatchPublic(BaseModel):
    """A batch in numbers."""

    id: str
    created: datetime
    owner: str | None  # name of a user
    expected: int  # items that were asked for
    accepted: int  # of which there is an evaluation
    refused: int  # fewer together than expected: it broke off; its key and request go on


class Batch(BatchPublic):
    """What became of every item, in the order given; of a matrix, suite after suite."""

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


Outcome = Literal["exact", "success", "failed", "running", "lost"]
Activity = Literal["queued", "starting", "playing", "lost", "waiting", "stopped", "incomplete"]


class LaneSpan(BaseModel):
    """An episode as it was played once."""

    episode: str
    task: str
    index: int
    start: datetime
    end: datetime | None  # null: it is played now
    outcome: Outcome  # lost: that try was; another played it again


class Lane(BaseModel):
    """What was played one after the other, while other lanes went beside it."""

    number: int  # from 1
    spans: list[LaneSpan]


class Phase(BaseModel):
    """What an evaluation's time was spent on."""

    activity: Activity
    start: datetime
    end: datetime
    detail: str  # why nobody played


class HistoryPublic(BaseModel):
    """How an evaluation went in wall time."""

    start: datetime  # when it was asked for
    end: datetime  # now, while it runs
    running: bool
    lanes: list[Lane]
    phases: list[Phase]  # without gaps of a second or more
    seconds: dict[Activity, float]  # of each


class LogLine(BaseModel):
    """Something that happened to an evaluation, in words."""

    seq: int
    time: datetime
    level: str  # "", note, good or bad
    text: str
    episode: str | None


class WorkersLog(BaseModel):
    """What workers printed."""

    lines: list[str]  # the newest last


class PublicationPublic(BaseModel):
    """Whether an evaluation may be published, and where it was."""

    publishable: bool
    reason: str | None  # why not
    snapshots: list["SnapshotPublic"]  # leaderboards that were kept with it in them


# --- episodes ---


class EpisodePublic(BaseModel):
    """One episode of an evaluation; the verdicts are null until it is final."""

    id: str
    evaluation: str
    policy: str
    version: int
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
    budget: int  # decisions that it may take
    stage: str | None  # what the world called for at the end
    scene_hash: str | None
    final_state_hash: str | None
    timing: Timing | None
    committed: datetime | None
    recording: str | None  # path of the .rrd; of a running episode it grows
    recording_removed: datetime | None  # when it was, to make room
    live: bool  # the recording is growing
    thumbnail: str | None  # path of a JPEG, 128 x 128
    preview: str | None  # path of an animated WebP, 128 x 128, a frame a decision
    sandbox: Sandbox | None  # around the policy's process; null if it had none, or not final


class EpisodeDetail(EpisodePublic):
    """One episode with what a reader wants beside it."""

    start: Start | None  # what was true before the first decision
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


class BeliefCheck(BaseModel):
    """How many stages a policy held to be done at a decision, and how many were."""

    decision: int
    believed: int
    true: list[int]  # each would be right; empty: no expert comes here
    right: bool | None  # null: nothing is known to be true


class BeliefsPublic(BaseModel):
    """What the policy of an episode believed, against the truth."""

    stated: int  # decisions at which it said how many stages it held to be done
    checked: int  # of these, those at which the truth is known
    right: int  # of these
    decisions: list[BeliefCheck]


class RerunPublic(BaseModel):
    """How to play an episode again on one's own machine, and what must come of it."""

    command: str  # with its own policy
    notes: list[str]  # what that needs and not every machine has
    replay: str  # with its actions alone, once they are downloaded
    scene_hash: str | None  # the same everywhere
    final_state_hash: str | None  # the same on a machine of the same kind


class FailureGroup(BaseModel):
    """How many episodes failed in one way."""

    category: Category
    task: str
    failure: Failure
    episodes: int


class FacetValue(BaseModel):
    """A value that episodes have, and how many of them."""

    value: str  # as a filter says it: "overcount", "count=3"
    episodes: int


class EpisodeFacets(BaseModel):
    """What the episodes of a filter differ in; counts respect the filters of other fields."""

    episodes: int  # that the filter finds
    facets: dict[str, list[FacetValue]]  # by field; hidden values and variations of one task alone


class PartingPublic(BaseModel):
    """Where two runs of the same episode part."""

    decision: int | None  # of the first run, the first that differs; null: both did the same
    other_decision: int | None = None  # its counterpart in the second
    time_a: float = 0.0  # simulated seconds at which each was chosen
    time_b: float = 0.0
    why: str  # a sentence
    other: str | None = None  # the episode that is the second run


class RunPublic(BaseModel):
    """Another run of the same episode."""

    episode: str
    evaluation: str
    policy: str
    version: int
    reference: bool
    success: bool
    exact: bool
    failure: Failure | None
    decisions: int


LabelName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.:-]{0,79}$")]


class LabelCreate(_Given):
    """What somebody says of an episode: a label, a note, or both."""

    label: LabelName | None = None
    note: Description = ""


class LabelPublic(BaseModel):
    """What somebody said of an episode."""

    id: str
    episode: str
    label: str | None
    note: str
    author: str  # name of a user
    created: datetime
    withdrawn: datetime | None
    withdrawn_by: str | None


class LabelCount(BaseModel):
    """On how many episodes a label stands."""

    label: str
    episodes: int


# --- queue and workers ---


class QueueReason(StrEnum):
    """Why shards wait."""

    NO_WORKERS = "no_workers"  # this server hands nothing out
    DISK_FULL = "disk_full"
    POLICY_BUSY = "policy_busy"  # the server of a remote policy plays as many as it takes
    WORKERS_BUSY = "workers_busy"
    OTHERS_FIRST = "others_first"


class QueueItem(BaseModel):
    """An evaluation of which shards wait."""

    position: int  # from 1
    evaluation: str
    policy: str
    version: int
    owner: str | None
    priority: int
    state: EvaluationState
    waiting: int  # shards
    running: int  # shards
    before: int  # shards of evaluations that stand before it
    reason: QueueReason
    detail: str  # the reason in a sentence


class Queue(BaseModel):
    """Evaluations in the order in which their next shards are handed out."""

    evaluations: int  # that wait
    shards: int
    items: list[QueueItem]  # the first of them


class WorkerPublic(BaseModel):
    """A shard that is handed out, and how far whoever plays it is."""

    attempt: str
    engine: str
    doing: Literal["begins", "plays", "between"]  # its first, an, or two episodes
    evaluation: str
    policy: str
    version: int
    task: str
    fence: int
    since: datetime
    episode: str | None  # that is played
    index: int | None
    episode_since: datetime | None
    final: int  # episodes of the shard
    episodes: int


class Workers(BaseModel):
    """What is handed out. A server keeps as many shards again at hand as it has slots."""

    slots: int  # shards that this machine plays at a time
    playing: int
    items: list[WorkerPublic]  # the longest at it first


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


class BeliefPublic(BaseModel):
    """At how many decisions the `stage_count` that a policy states is right, of those at which the
    truth is known: where the expert comes too.
    """

    right: int
    decisions: int
    episodes: int
    value: float
    low: float  # 95 %; decisions of one episode are not taken for independent tries
    high: float


class NormalisedPublic(BaseModel):
    """(rate - ceiling) / (1 - ceiling), of the rate over the tasks that count and the mean of
    their ceilings: 0 is the most that is possible without memory, 1 is all, less than 0 is less.
    """

    value: float
    low: float  # 95 %, of the rate's
    high: float
    tasks: list[str]  # that count: of a strong certificate and a ceiling below 1
    episodes: int


class LeaderboardRow(BaseModel):
    """A policy's latest complete evaluation."""

    rank: int | None  # null for reference policies
    # The ranks that it may have, together with the others' in 95 % of all leaderboards: it is
    # shown to be worse than `rank_best` - 1 policies, and better than those below `rank_worst`.
    rank_best: int | None
    rank_worst: int | None
    evaluation: str
    policy: str
    version: int
    reference: bool
    ended: datetime
    tasks: dict[str, Verdicts]
    categories: dict[str, Verdicts]  # RC, HSR, EPT
    overall: Verdicts
    # What snapshots of before do not have:
    policy_version: str | None = None
    owner: str | None = None  # of the policy, name of a user; null: the server's own
    gap: RatePublic | None = None  # successes that are not exact
    normalised: NormalisedPublic | None = None  # of the ranking verdict
    belief: BeliefPublic | None = None  # null: the policy states none
    facts: PolicyFacts | None = None  # what is known of its memory


class Leaderboard(BaseModel):
    """Complete evaluations of the whole suite, best first; reference policies follow."""

    suite: str
    split: Split
    verdict: Verdict  # ranks by it
    columns: list[LeaderboardColumn]
    ceilings: dict[str, float | None]  # of the ranking verdict: per task, per category, "overall"
    rows: list[LeaderboardRow]
    unlisted: int  # evaluations of the split that are incomplete, partial, or superseded
    left_out: int = 0  # rows, by the filters; ranks are those among all


class PublishedRow(BaseModel):
    """A method's line of the paper's main table, in percent as it is printed."""

    method: str
    memory_based: bool
    tasks: dict[str, float]
    categories: dict[str, float]
    overall: float


class PublishedPublic(BaseModel):
    """What the paper printed; it is never ranked with what was measured here."""

    source: str
    simulator: str
    comparable: Literal[False]
    episodes: int  # of each task
    rows: list[PublishedRow]


class SnapshotCreate(_Given):
    """A snapshot to be taken."""

    split: Split = "test"
    note: Description = ""


class SnapshotPublic(BaseModel):
    """A leaderboard that was kept; it never changes."""

    number: int
    sha256: str  # of the bytes at `content`
    content: str  # path
    split: Split
    note: str
    created: datetime
    owner: str | None  # name of the user who took it


class SnapshotEvaluation(BaseModel):
    """What a row of a snapshot rests on."""

    evaluation: str
    policy_version: str
    results: str  # SHA-256 of its episodes' digests, one a line, by task and index
    sources: dict[str, str]  # per task, the code that played it
    machine: dict[str, Any]


class SnapshotContent(BaseModel):
    """The content of a snapshot."""

    format: Literal[1] = 1
    software: str
    statistics: str  # the methods
    episodes: str  # SHA-256 of what is played: names and scene hashes, one a line
    leaderboards: dict[Verdict, Leaderboard]
    evaluations: list[SnapshotEvaluation]


# --- comparisons ---


class PairedTable(BaseModel):
    """Episodes by what both policies made of them."""

    both: int
    only_a: int
    only_b: int
    neither: int


class Paired(BaseModel):
    """Two policies on the same episodes."""

    a: RatePublic
    b: RatePublic
    table: PairedTable
    difference: float  # of the rates, A less B; over several tasks their mean
    low: float  # 95 %, Newcombe's interval for paired rates
    high: float
    p: float  # McNemar, mid-p
    p_exact: float


class TaskComparison(Paired):
    """One task."""

    task: str
    category: Category
    p_holm: float  # `p` adjusted for the number of tasks


class GroupComparison(Paired):
    """The tasks of a category, or all."""

    tasks: int
    # 95 %, bootstrapped; null where no episode went differently, or for one task
    over_episodes: tuple[float, float] | None  # of other episodes of these tasks
    over_tasks: tuple[float, float] | None  # of other tasks like these


class Discordant(BaseModel):
    """An episode that one policy managed and the other did not."""

    task: str
    index: int
    better: Literal["a", "b"]
    a: str  # episode
    b: str


class Compared(BaseModel):
    """One side of a comparison."""

    evaluation: str
    policy: str
    version: int


class Comparison(BaseModel):
    """Two completed evaluations on the episodes that both played."""

    a: Compared
    b: Compared
    suite: str
    split: Split
    rules: Rules
    verdict: Verdict
    statistics: str  # the methods
    other_sources: list[str]  # tasks that were played by different code
    same_machine: bool  # or machines alike
    tasks: list[TaskComparison]
    categories: dict[str, GroupComparison]
    overall: GroupComparison
    discordant: list[Discordant]


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


# --- webhooks ---


WebhookUrl = Annotated[str, Field(min_length=1, max_length=500)]
WebhookEvents = Annotated[list[WebhookEvent], Field(min_length=1, max_length=len(WebhookEvent))]
WHEN_ENDED = [
    WebhookEvent.EVALUATION_COMPLETED,
    WebhookEvent.EVALUATION_INCOMPLETE,
    WebhookEvent.EVALUATION_CANCELLED,
]


class WebhookCreate(_Given):
    """An address that is to be told what happens."""

    url: WebhookUrl  # https://…
    events: WebhookEvents = WHEN_ENDED
    everybodys: StrictBool = False  # else of one's own evaluations alone
    description: Description = ""


class WebhookChange(_Given):
    """What is to be different about a webhook; what is left out stays."""

    url: WebhookUrl = ""
    events: WebhookEvents = WHEN_ENDED
    everybodys: StrictBool = False
    description: Description = ""
    active: StrictBool = True


class WebhookPublic(BaseModel):
    """A webhook without its secret."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    url: str
    events: list[WebhookEvent]
    everybodys: bool
    description: str
    active: bool
    reason: str | None  # why it is not active, if nobody switched it off
    created: datetime


class WebhookCreated(WebhookPublic):
    """A webhook with what its deliveries are signed with; it is told this once."""

    secret: str  # whsec_…, as of https://www.standardwebhooks.com


class DeliveryTry(BaseModel):
    """One try to deliver."""

    time: datetime
    status: int | None  # that the receiver answered, as HTTP
    error: str | None  # why there is none


class DeliveryPublic(BaseModel):
    """An event on its way to a webhook."""

    model_config = ConfigDict(from_attributes=True)

    id: str  # its `webhook-id`
    kind: WebhookEvent
    state: DeliveryState
    body: str  # as it is signed
    tries: list[DeliveryTry]
    due: datetime | None  # the next try
    created: datetime


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
