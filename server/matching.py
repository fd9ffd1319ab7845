"""What is true of the episodes that are wanted, as the database understands it."""

import json
from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Text, and_, cast, or_, select
from sqlalchemy.orm import aliased

from server import labels
from server.models import Episode, Evaluation, HiddenSpan, Policy, PolicyVersion
from server.wanted import VerdictName, Wanted, pairs

VERDICTS: dict[VerdictName, ColumnElement[bool]] = {
    "inexact": Episode.failure.is_not(None),
    "failed": Episode.success.is_(False),
    "success": and_(Episode.success.is_(True), Episode.exact.is_(False)),
    "exact": Episode.exact.is_(True),
}


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
        found.append(labels.has(wanted.label))
    if wanted.labelled is not None:
        found.append(labels.any_stands() if wanted.labelled else ~labels.any_stands())
    return found + [_says(word) for word in dict.fromkeys((wanted.text or "").split())]


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
