"""Which episodes a page shows, and in which order; it travels in the address."""

from typing import Any
from urllib.parse import quote

from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from server.episode_order import Sort
from server.matching import Wanted
from web.templating import query
from web.wording import words

# A form sends what was not chosen as an empty text.
EMPTY_IS_NONE = BeforeValidator(lambda value: value or None)
OF_ONE_TASK = ("hidden", "variation")  # for others these name other things


class Filters(Wanted):
    """What is asked for; what is left out does not matter, but without a verdict: not exact."""

    model_config = ConfigDict(extra="ignore")

    sort: Sort = Sort.NEWEST
    cursor: str | None = Field(None, max_length=500)

    @field_validator("*", mode="before")
    @classmethod
    def _empty_is_none(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, list):
            value = [one for one in value if one != ""]
        assert info.field_name, "it is a field's"
        empty = value in (None, "", [])
        return cls.model_fields[info.field_name].get_default() if empty else value

    @property
    def asked(self) -> Wanted:
        """The same as `server.facets` and the API are asked."""
        chosen = {name: getattr(self, name) for name in Wanted.model_fields}
        return Wanted.model_construct(**{**chosen, "verdict": self.verdict or ["inexact"]})

    def wanted(self) -> dict[str, Any]:
        """The same as arguments of `server.episodes.listed` and `beside`."""
        return {**dict(self.asked), "sort": self.sort}

    def fields(self, **changed: object) -> dict[str, Any]:
        """What stands in the address, without the cursor; `changed` replaces."""
        kept = self.model_dump(mode="json", exclude_defaults=True, exclude={"cursor"})
        return {**kept, **changed}

    def inputs(self, **changed: object) -> list[tuple[str, str]]:
        """The same for a form: a hidden input each."""
        several = {k: v if isinstance(v, list) else [v] for k, v in self.fields(**changed).items()}
        return [(name, str(value)) for name, values in several.items() for value in values if value]

    def of_episode(self) -> dict[str, Any]:
        """What stands in the address of an episode of the list: never nothing."""
        return self.fields(verdict=self.verdict or ["inexact"])

    def of_counts(self) -> dict[str, Any]:
        """What stands in the address of the counts by REST."""
        return {name: value for name, value in self.of_episode().items() if name != "sort"}

    def toggled(self, name: str, value: str) -> dict[str, Any]:
        """What stands in the address with one value more, or without it if it is chosen."""
        chosen = [str(one) for one in getattr(self, name)]
        values = [one for one in chosen if one != value] if value in chosen else [*chosen, value]
        others: dict[str, Any] = dict.fromkeys(OF_ONE_TASK) if name == "task" else {}
        return self.fields(**others, **{name: values})

    def address(self, **changed: object) -> str:
        """Of the page that shows these; that of a single evaluation has one of its own."""
        return address_of(self.fields(**changed))

    @property
    def alone(self) -> str:
        """The address with nothing chosen, of the same evaluation."""
        return address_of({"evaluation": self.evaluation if len(self.evaluation) == 1 else []})

    @property
    def given(self) -> bool:
        """True when the address names any of them."""
        return bool(self.fields())

    @property
    def said(self) -> str:
        """A few words for a link that leads back to the list."""
        what = " or ".join(map(words, self.failure)) or "episodes"
        return f"{what} in {', '.join(self.task)}" if self.task else what


def address_of(fields: dict[str, Any]) -> str:
    """The page of the failures with these fields."""
    evaluations = fields.get("evaluation") or []
    if len(evaluations) != 1:
        return f"/failures{query(**fields)}"
    others = {name: value for name, value in fields.items() if name != "evaluation"}
    return f"/evaluations/{quote(evaluations[0], safe='')}/failures{query(**others)}"
