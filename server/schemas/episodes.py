"""Episodes: what was measured of them, how they compare, what people say of them."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import BaseModel, Field

from hide_tasks.contract import (
    Category,
    DecisionRecord,
    Failure,
    HiddenState,
    Split,
    Start,
    Timing,
    Value,
    Variation,
)
from server.schemas.common import Description, Given
from server.states import EpisodeState
from workers.sandbox.choice import Sandbox


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


class LabelCreate(Given):
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
