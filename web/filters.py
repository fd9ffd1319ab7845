"""Which episodes of an evaluation are asked for; it travels in the address."""

from typing import Any, Literal

from pydantic import BaseModel, BeforeValidator, field_validator

from hide_tasks.contract import Category, Failure

# A form sends what was not chosen as an empty text.
EMPTY_IS_NONE = BeforeValidator(lambda value: value or None)

Shown = Literal["inexact", "failed", "success", "exact", "all"]
WANTED: dict[str, dict[str, bool]] = {
    "inexact": {"exact": False},
    "failed": {"success": False},
    "success": {"success": True, "exact": False},
    "exact": {"exact": True},
    "all": {},
}


class Filters(BaseModel):
    """A category, a task, a failure, a verdict; none of them means all."""

    category: Category | None = None
    task: str | None = None
    failure: Failure | None = None
    verdict: Shown | None = None
    cursor: str | None = None

    @field_validator("*", mode="before")
    @classmethod
    def _empty_is_none(cls, value: Any) -> Any:
        return value or None

    def wanted(self) -> dict[str, Any]:
        """The same as arguments of `server.episodes.listed`."""
        named = {"category": self.category, "task": self.task, "failure": self.failure}
        return {**named, **WANTED[self.verdict or "inexact"]}

    def fields(self, **changed: object) -> dict[str, Any]:
        """What stands in the address, without the cursor; `changed` replaces."""
        return {**self.model_dump(mode="json", exclude={"cursor"}), **changed}

    @property
    def given(self) -> bool:
        """True when the address names any of them."""
        return any(self.fields().values())
