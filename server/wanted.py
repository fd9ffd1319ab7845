"""Which episodes are asked for. Several values of a field are alternatives; fields narrow."""

import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from hide_tasks import ALL_TASKS, UnknownTask, load
from hide_tasks.contract import Category, Failure
from server.problems import invalid
from server.states import EpisodeState

VerdictName = Literal["inexact", "failed", "success", "exact", "all"]
MOST = 50  # values of a field


def _listed(value: Any) -> Any:
    """One value is a list of one, none is an empty list."""
    if value is None:
        return []
    return value if isinstance(value, list | tuple) else [value]


class _OneOrMore:
    """Described as one value, as none, or as several: in an address they are written alike."""

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, Any]:
        several = handler(core)
        return {"anyOf": [several["items"], several, {"type": "null"}]}


Item = TypeVar("Item")
Several = Annotated[list[Item], BeforeValidator(_listed), Field(max_length=MOST), _OneOrMore()]
Name = Annotated[str, Field(max_length=80)]
Pair = Annotated[str, Field(max_length=160, pattern="^[^=]+=", description="name=value")]


class Within(BaseModel):
    """Which episodes of an evaluation; what is left out does not matter."""

    model_config = ConfigDict(extra="forbid")

    category: Several[Category] = []
    task: Several[Name] = []
    failure: Several[Failure] = []
    verdict: Several[VerdictName] = []
    success: bool | None = None
    exact: bool | None = None
    state: Several[EpisodeState] = []
    stage: Several[Name] = []  # what the world called for at the end
    hidden: Several[Pair] = []  # at the end
    variation: Several[Pair] = []
    label: Several[Name] = []  # that stands
    labelled: bool | None = None  # with any label or note
    text: Annotated[str, Field(max_length=200)] | None = None  # words; all are looked for

    @field_validator("text")
    @classmethod
    def _is_printable(cls, text: str | None) -> str | None:
        if text is not None and not text.isprintable():
            raise ValueError("has characters that cannot be printed; write plain words")
        return text

    @field_validator("hidden", "variation", mode="wrap")
    @classmethod
    def _says_what_is_right(cls, value: Any, handler: Any) -> Any:
        for one in _listed(value):
            if not isinstance(one, str) or not one.partition("=")[0] or "=" not in one:
                raise ValueError(f"'{str(one)[:40]}' is no name=value, e.g. count=3")
        return handler(value)


class Wanted(Within):
    """Which episodes of all evaluations."""

    evaluation: Several[Name] = []
    policy: Several[Name] = []  # name, or name@version

    def without(self, *names: str) -> Self:
        """The same without some fields."""
        return self.model_copy(
            update={name: type(self).model_fields[name].get_default() for name in names}
        )

    def require_known(self) -> None:
        """Does nothing if its tasks and axes are the suite's.

        Raises:
            Problem: 422, one is not; it says which there are.
        """
        for task in self.task:
            try:
                load(task)
            except UnknownTask as error:
                raise invalid("task", str(error)) from None
        known = _axes(self.task or ALL_TASKS)
        for name in pairs(self.variation):
            if name not in known:
                there = f"there are {', '.join(known)}" if known else "it has none"
                raise invalid("variation", f"no axis '{name[:40]}'; {there}")


def _axes(tasks: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(axis for task in tasks for axis in load(task).axes()))


def pairs(written: Sequence[str]) -> dict[str, list[str]]:
    """The values of each name."""
    found: dict[str, list[str]] = defaultdict(list)
    for one in written:
        name, _, value = one.partition("=")
        found[name].append(value)
    return dict(found)


def pair(name: str, value: Any) -> str:
    """A name and a value as an address says them."""
    return f"{name}={value if isinstance(value, str) else json.dumps(value)}"
