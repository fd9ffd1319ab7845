"""What a comparison of several policies answers: documents of the API."""

from pydantic import BaseModel

from hide_tasks.contract import Category, Failure, Rules, Split
from server.schemas.common import RatePublic, Verdict
from server.schemas.comparisons import Compared, Paired
from server.schemas.leaderboard import BeliefPublic
from server.schemas.policies import PolicyFacts


class Entrant(Compared):
    """One of the policies that are compared."""

    facts: PolicyFacts


class Mean(BaseModel):
    """A mean with its interval; null without episodes."""

    value: float | None
    low: float | None  # 95 %, Student's t; null for fewer than two episodes
    high: float | None
    episodes: int


class Figures(BaseModel):
    """What else was measured of a policy on the episodes of a comparison."""

    success: RatePublic
    exact: RatePublic
    gap: RatePublic  # managed, but not exactly
    decisions: Mean  # in the episodes that all managed
    belief: BeliefPublic | None  # over its whole evaluation; null where it says nothing


class PairComparison(Paired):
    """Two of several; `first` and `second` are their places in the list of policies, from 0."""

    first: int
    second: int
    p_holm: float  # `p` adjusted for the number of pairs


class SeveralGroup(BaseModel):
    """The tasks of a category, or all."""

    tasks: int
    episodes: int
    rates: list[RatePublic]
    ranks: list[tuple[int, int]]  # the best and the worst that chance leaves, among these policies
    pairs: list[PairComparison]


class SeveralTask(BaseModel):
    """One task."""

    task: str
    category: Category
    rates: list[RatePublic]


class SeveralEpisode(BaseModel):
    """An episode that all played; each list has one entry per policy, in their order."""

    task: str
    category: Category
    index: int
    episodes: list[str]
    managed: list[bool]  # by the comparison's verdict
    failures: list[Failure | None]


class SeveralComparison(BaseModel):
    """Two to six completed evaluations on the episodes that all of them played."""

    policies: list[Entrant]
    suite: str
    split: Split
    rules: Rules
    verdict: Verdict
    statistics: str  # the methods
    other_sources: list[str]  # tasks that were not played by the same code everywhere
    same_machine: bool  # or machines alike
    overall: SeveralGroup
    categories: dict[str, SeveralGroup]
    tasks: list[SeveralTask]
    figures: list[Figures]
    episodes: list[SeveralEpisode]
