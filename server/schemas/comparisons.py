"""Two policies on the same episodes."""

from typing import Literal

from pydantic import BaseModel

from hide_tasks.contract import Category, Rules, Split
from server.schemas.common import RatePublic, Verdict


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
