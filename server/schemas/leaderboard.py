"""The leaderboard, and what the paper printed."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel

from hide_tasks.contract import Category, Split
from server.schemas.common import RatePublic, Verdict, Verdicts
from server.schemas.policies import PolicyFacts
from server.schemas.tasks import CertificatePublic


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
