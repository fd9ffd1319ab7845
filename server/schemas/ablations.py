"""What the ablations answer: documents of the API."""

from pydantic import BaseModel

from hide_tasks.contract import Split
from server.schemas.common import RatePublic, Verdict
from server.schemas.policies import PolicyFacts


class AblationVersion(BaseModel):
    """A policy's version that was measured; several of one cell are seeds, as a rule."""

    policy: str
    version: int
    evaluation: str
    facts: PolicyFacts
    rates: dict[str, RatePublic]  # overall, and by category


class MeanRate(BaseModel):
    """A mean over versions that played the same episodes."""

    value: float
    low: float  # 95 %, Wilson's of as many episodes: another version is no other episode
    high: float
    episodes: int
    versions: int
    least: float  # of a version
    most: float


class AblationTest(BaseModel):
    """The difference from another cell, on the same episodes."""

    difference: float
    low: float  # 95 %, Newcombe's for paired rates
    high: float
    p: float  # signs of the episodes' differences flipped, mid-p; of two versions, McNemar's
    p_holm: float  # adjusted for the tests of the block


class AblationRow(BaseModel):
    """A line of the paper's table or figure; `rates` is null where nothing was measured."""

    key: str
    label: str
    preset: str | None  # what `hide train` takes
    published: dict[str, float] | None  # percent, in the paper's own simulator
    published_steps: dict[str, float] | None  # points that the paper says it adds
    versions: list[AblationVersion]
    rates: dict[str, MeanRate] | None
    against: str | None  # the key that it is tested against
    tests: dict[str, AblationTest] | None


class AblationBlock(BaseModel):
    """Lines that differ in one thing."""

    name: str
    title: str
    rows: list[AblationRow]


class Ablations(BaseModel):
    """Memory's length, content and components, as measured here and as published."""

    suite: str
    split: Split
    verdict: Verdict
    size: str
    clock: bool
    statistics: str
    measured: int  # versions in cells
    places: dict[str, int]  # versions by size and clock, e.g. 'small+clock'
    blocks: list[AblationBlock]
