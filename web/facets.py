"""Facets as a page shows them: every value a link that narrows, or widens if it is chosen."""

import json
from typing import NamedTuple

from sqlalchemy.orm import Session

from hide_tasks.contract import Category, Failure
from server import evaluations, facets
from server.schemas.episodes import EpisodeFacets, FacetValue
from web.filters import Filters
from web.wording import CATEGORIES, FAILURES, VERDICTS, value, words

TITLES = {
    "failure": "Failure",
    "policy": "Policy",
    "category": "Category",
    "task": "Task",
    "hidden": "Hidden value at the end",
    "variation": "Variation",
    "stage": "Stage reached",
    "verdict": "Verdict",
    "label": "Label",
}
FEW = 8  # values that are shown at once


class Choice(NamedTuple):
    """A value of a facet."""

    name: str
    hint: str
    episodes: int
    chosen: bool
    address: str
    share: float  # of the most frequent value, in percent


class Facet(NamedTuple):
    """A field and its values."""

    field: str
    title: str
    choices: list[Choice]
    more: list[Choice]
    chosen: int  # how many


class Chosen(NamedTuple):
    """A filter that is set, and the page without it."""

    title: str
    name: str
    address: str
    without: int | None  # episodes that would be found; counted only if none is


def shown_facets(filters: Filters, counted: EpisodeFacets) -> list[Facet]:
    """The facets that have a value, those of one task only if it is chosen."""
    found = (_facet(filters, name, counted.facets.get(name, [])) for name in TITLES)
    return [one for one in found if one.choices]


def _facet(filters: Filters, field: str, values: list[FacetValue]) -> Facet:
    most = max((one.episodes for one in values), default=1) or 1
    there = [one.value for one in values]
    filters = _versioned(filters, there) if field == "policy" else filters
    asked = [str(one) for one in getattr(filters, field)]
    values = [*values, *(FacetValue(value=v, episodes=0) for v in asked if v not in there)]
    choices = [
        Choice(
            name=name_of(field, one.value),
            hint=_hint(field, one.value),
            episodes=one.episodes,
            chosen=one.value in asked,
            address=filters.address(**filters.toggled(field, one.value)),
            share=100 * one.episodes / most,
        )
        for one in values
    ]
    few = len(choices) if len(choices) <= FEW + 1 else FEW
    first = [one for at, one in enumerate(choices) if at < few or one.chosen]
    rest = [one for at, one in enumerate(choices) if at >= few and not one.chosen]
    return Facet(field, TITLES[field], first, rest, sum(one.chosen for one in choices))


def _versioned(filters: Filters, there: list[str]) -> Filters:
    """A policy's bare name is all its versions that are there."""
    versions: dict[str, list[str]] = {}
    for one in there:
        versions.setdefault(one.rpartition("@")[0], []).append(one)
    asked = [v for one in filters.policy for v in versions.get(one, [one])]
    return filters.model_copy(update={"policy": list(dict.fromkeys(asked))})


def name_of(field: str, written: str) -> str:
    """A value as people read it."""
    if field in ("hidden", "variation"):
        name, _, said = written.partition("=")
        return f"{words(name)} {_value(said)}"
    if field == "verdict":
        return VERDICTS.get(written, written)
    return words(written) if field == "failure" else written


def _value(said: str) -> str:
    try:
        return value(json.loads(said))
    except (ValueError, RecursionError):
        return said


def _hint(field: str, written: str) -> str:
    if field == "failure":
        return FAILURES[Failure(written)]
    return CATEGORIES[Category(written)] if field == "category" else ""


def chosen(session: Session, filters: Filters, *, empty: bool) -> list[Chosen]:
    """Every filter that is set; `empty`: also what would be found without it."""
    found = [
        (name, one, filters.toggled(name, one))
        for name in ("evaluation", *TITLES)
        for one in map(str, getattr(filters, name))
    ]
    if filters.text:
        found.append(("text", filters.text, filters.fields(text=None)))
    if filters.labelled is not None:
        said = "with any" if filters.labelled else "without any"
        found.append(("labelled", said, filters.fields(labelled=None)))
    return [
        Chosen(
            title={"evaluation": "Evaluation", "text": "Text", "labelled": "Label"}.get(field)
            or TITLES[field],
            name=_evaluation(session, one) if field == "evaluation" else name_of(field, one),
            address=filters.address(**fields),
            without=facets.count(session, Filters(**fields).asked) if empty else None,
        )
        for field, one, fields in found
    ]


def _evaluation(session: Session, id: str) -> str:
    version = evaluations.row(session, id).policy_version
    return f"{version.policy.name}@{version.number}"
