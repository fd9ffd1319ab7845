"""Which episodes are asked for. Several values of a field are alternatives; fields narrow."""

import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator
from sqlalchemy import ColumnElement, Text, and_, cast, or_, select
from sqlalchemy.orm import aliased

from hide_tasks import ALL_TASKS, UnknownTask, load
from hide_tasks.contract import Category, Failure
from server import labels
from server.models import Episode, Evaluation, HiddenSpan, Policy, PolicyVersion
from server.problems import invalid
from server.states import EpisodeState

VerdictName = Literal["inexact", "failed", "success", "exact", "all"]
VERDICTS: dict[VerdictName, ColumnElement[bool]] = {
    "inexact": Episode.failure.is_not(None),
    "failed": Episode.success.is_(False),
    "success": and_(Episode.success.is_(True), Episode.exact.is_(False)),
    "exact": Episode.exact.is_(True),
}


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


def conditions(wanted: Wanted) -> list[ColumnElement[bool]]:
    """What is true of every episode that is wanted."""
    columns: dict[Any, Sequence[str]] = {
        Episode.evaluation_id: wanted.evaluation,
        Episode.category: wanted.category,
        Episode.task: wanted.task,
        Episode.failure: wanted.failure,
        Episode.state: wanted.state,
        Episode.stage: wanted.stage,
    }
    found: list[ColumnElement[bool]] = [
        column.in_(values) for column, values in columns.items() if values
    ]
    flags: dict[Any, bool | None] = {
        Episode.success: wanted.success,
        Episode.exact: wanted.exact,
    }
    found += [column == value for column, value in flags.items() if value is not None]
    if wanted.verdict and "all" not in wanted.verdict:
        found.append(or_(*(VERDICTS[one] for one in wanted.verdict)))
    found += [_ends_with(name, values) for name, values in pairs(wanted.hidden).items()]
    found += [_is_varied(axis, values) for axis, values in pairs(wanted.variation).items()]
    return [*found, *_of_people(wanted)]


def _of_people(wanted: Wanted) -> list[ColumnElement[bool]]:
    """Whose policy, what was said of it, and what is searched for."""
    found = [_plays(wanted.policy)] if wanted.policy else []
    if wanted.label:
        found.append(or_(*map(labels.has, wanted.label)))
    if wanted.labelled is not None:
        found.append(labels.any_stands() if wanted.labelled else ~labels.any_stands())
    return found + [_says(word) for word in (wanted.text or "").split()]


def _plays(names: Sequence[str]) -> ColumnElement[bool]:
    any_of = [
        and_(Policy.name == name, *([PolicyVersion.number == int(version)] if version else []))
        for name, version in map(_versioned, names)
    ]
    played = select(Evaluation.id).join(PolicyVersion).join(Policy).where(or_(*any_of))
    return Episode.evaluation_id.in_(played)


def _versioned(written: str) -> tuple[str, str]:
    name, _, version = written.rpartition("@")
    known = name and version.isdecimal() and version.isascii() and len(version) < 10
    return (name, version) if known else (written, "")


def _says(word: str) -> ColumnElement[bool]:
    columns = (Episode.instruction, Episode.detail)
    there = [column.icontains(word, autoescape=True) for column in columns]
    return or_(*there, labels.noted(word))


def _ends_with(name: str, values: Sequence[str]) -> ColumnElement[bool]:
    """True where a hidden value held at the end."""
    span = aliased(HiddenSpan)
    there = select(span.episode_id).where(
        span.episode_id == Episode.id,
        span.name == name,
        cast(span.value, Text).in_(_as_json(values)),
        is_last(span),
    )
    return there.correlate(Episode).exists()


def is_last(span: Any) -> ColumnElement[bool]:
    """True for the hidden value that held at the end of an episode."""
    later = aliased(HiddenSpan)
    after = select(later.episode_id).where(
        later.episode_id == span.episode_id,
        later.kind == span.kind,
        later.name == span.name,
        later.number == span.number + 1,
    )
    # Joined with nothing, the kind is no reason for SQLite to go through all episodes' spans.
    return and_(span.kind.concat("") == "hidden", ~after.exists())


def _is_varied(axis: str, values: Sequence[str]) -> ColumnElement[bool]:
    return cast(Episode.variation[axis], Text).in_(_as_json(values))


def _as_json(values: Sequence[str]) -> list[str]:
    """What a value of an address may be in the ledger: a text, or what it is as JSON."""
    found = [json.dumps(value) for value in values]
    for value in values:
        try:
            found.append(json.dumps(json.loads(value)))
        except (ValueError, RecursionError):
            continue
    return found
