"""Tasks and their certificates."""

from typing import Literal

from pydantic import BaseModel

from hide_tasks.contract import Category, Failure, HiddenState, Value


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
    """One task of a suite."""

    name: str
    suite: str
    category: Category
    instruction: str
    paraphrases: list[str]
    variations: int
    axes: dict[str, list[Value]]
    hidden_axes: list[str]
    keyframes: list[int]
    budget: int
    cameras: list[str]  # that it is seen through
    hidden_state: str
    failures: dict[Failure, str]  # which can occur here, and how
    certificate: CertificatePublic | None
    aliases: list[AliasPublic]
    picture: str | None  # path
