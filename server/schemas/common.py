"""What several documents of the API are made of."""

from typing import Annotated, Generic, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from hide_tasks.statistics import Rate

Item = TypeVar("Item")
Verdict = Literal["success", "exact"]
PolicyName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.:+-]{0,79}$")]
Description = Annotated[str, Field(max_length=2000)]
SuiteName = Literal["smoke", "RC", "HSR", "EPT", "full", "hide", "hide-hard", "real4"]
Component = Literal["SCM", "WCM", "PAM"]
Covers = Literal["smoke", "RC", "HSR", "EPT", "full", "hide-hard", "real4", "part"]


class Given(BaseModel):
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
