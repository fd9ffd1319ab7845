"""Evaluations: asked for, estimated, in batches, as they stand."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, Field, StrictBool
from pydantic_core import PydanticCustomError

from hide_tasks.contract import Category, Rules, Split
from server.schemas.common import Covers, Given, SuiteName, Verdicts
from server.schemas.people import Quotas
from server.states import AttemptState, Desired, EvaluationState
from workers.sandbox.choice import Sandbox


def _some_tasks(value: Any) -> Any:
    if value == []:
        raise PydanticCustomError("too_short", "choose at least one task")
    return value


Tasks = Annotated[list[str], Field(min_length=1), BeforeValidator(_some_tasks)]


class EvaluationCreate(Given):
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


class Matrix(Given):
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


class BatchCreate(Given):
    """Many evaluations at once, 200 at most: listed one by one, or a matrix."""

    items: list[dict[str, Any]] = Field(default=[], max_length=200)
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
    quotas: Quotas
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
