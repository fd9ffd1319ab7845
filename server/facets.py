"""What episodes differ in, counted: each value of a field, with the number of episodes of it.

The counts of a field respect the filters of all other fields, not its own: they say what would be
found if that value were chosen instead.
"""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

from sqlalchemy import ColumnElement, Text, case, cast, func, select
from sqlalchemy.orm import Session

from hide_tasks.contract import Category
from server import labels
from server.matching import conditions, is_last
from server.models import Episode, Evaluation, HiddenSpan, Policy, PolicyVersion
from server.schemas.episodes import EpisodeFacets, FacetValue
from server.wanted import Wanted, pair, pairs

VERDICT = case(
    (Episode.exact.is_(True), "exact"),
    (Episode.success.is_(True), "success"),
    (Episode.success.is_(False), "failed"),
)
COLUMNS: dict[str, Any] = {
    "category": Episode.category,
    "task": Episode.task,
    "failure": Episode.failure,
    "verdict": VERDICT,
    "stage": Episode.stage,
}
MOST = 200  # values of a field


def facets(session: Session, wanted: Wanted) -> EpisodeFacets:
    """How many episodes are wanted, and what they differ in; hidden values and variations of one
    task alone, for others name other things."""
    found = {name: _by_column(session, wanted, name) for name in COLUMNS}
    found["policy"] = _by_policy(session, wanted.without("policy"))
    found["label"] = _by_label(session, wanted.without("label"))
    if len(wanted.task) == 1:
        found["hidden"] = list(_by_hidden(session, wanted))
        found["variation"] = list(_by_variation(session, wanted))
    return EpisodeFacets(episodes=count(session, wanted), facets=found)


def count(session: Session, wanted: Wanted) -> int:
    """How many episodes are wanted."""
    return session.scalar(select(func.count()).select_from(Episode).where(*conditions(wanted))) or 0


def _by_column(session: Session, wanted: Wanted, name: str) -> list[FacetValue]:
    column, number = COLUMNS[name], func.count()
    rows = session.execute(
        select(column, number)
        .where(*conditions(wanted.without(name)), column.is_not(None))
        .group_by(column)
        .order_by(number.desc(), column)
        .limit(MOST)
    )
    found = [FacetValue(value=value, episodes=episodes) for value, episodes in rows]
    if name == "category":
        found.sort(key=lambda one: list(Category).index(Category(one.value)))
    return found


def _by_policy(session: Session, wanted: Wanted) -> list[FacetValue]:
    number = func.count()
    counted = (
        select(Episode.evaluation_id, number.label("episodes"))
        .where(*conditions(wanted))
        .group_by(Episode.evaluation_id)
        .subquery()
    )
    episodes = func.sum(counted.c.episodes)
    rows = session.execute(
        select(Policy.name, PolicyVersion.number, episodes)
        .select_from(counted)
        .join(Evaluation, Evaluation.id == counted.c.evaluation_id)
        .join(PolicyVersion, PolicyVersion.id == Evaluation.policy_version_id)
        .join(Policy, Policy.id == PolicyVersion.policy_id)
        .group_by(Policy.name, PolicyVersion.number)
        .order_by(episodes.desc(), Policy.name, PolicyVersion.number)
        .limit(MOST)
    )
    return [FacetValue(value=f"{name}@{n}", episodes=int(sum_)) for name, n, sum_ in rows]


def _by_label(session: Session, wanted: Wanted) -> list[FacetValue]:
    found = labels.counted(session, *conditions(wanted))
    return [FacetValue(value=one.label, episodes=one.episodes) for one in found[:MOST]]


def _by_hidden(session: Session, wanted: Wanted) -> Iterator[FacetValue]:
    """Of each name, its values at the end; a chosen name's own filter does not count."""
    chosen = pairs(wanted.hidden)
    yield from _hidden(session, wanted, HiddenSpan.name.not_in(list(chosen)))
    for name in chosen:
        others = [one for one in wanted.hidden if one.partition("=")[0] != name]
        apart = wanted.model_copy(update={"hidden": others})
        yield from _hidden(session, apart, HiddenSpan.name == name)


def _hidden(session: Session, wanted: Wanted, named: ColumnElement[bool]) -> Iterator[FacetValue]:
    value, number = cast(HiddenSpan.value, Text), func.count()
    ids = select(Episode.id).where(*conditions(wanted))
    rows = session.execute(
        select(HiddenSpan.name, value, number)
        .where(HiddenSpan.episode_id.in_(ids), named, is_last(HiddenSpan))
        .group_by(HiddenSpan.name, value)
        .limit(MOST)
    )
    for name, text, episodes in sorted(rows, key=lambda row: (row[0], _in_order(row[1]))):
        yield FacetValue(value=pair(name, json.loads(text)), episodes=episodes)


def _in_order(text: str) -> tuple[bool, float, str]:
    """Numbers by size, then the rest by name."""
    value = json.loads(text)
    is_number = isinstance(value, int | float)
    return not is_number, value if is_number else 0.0, text


def _by_variation(session: Session, wanted: Wanted) -> Iterator[FacetValue]:
    chosen, text, number = pairs(wanted.variation), cast(Episode.variation, Text), func.count()
    rows = session.execute(
        select(text, number).where(*conditions(wanted.without("variation"))).group_by(text)
    )
    points = [(json.loads(point), episodes) for point, episodes in rows]
    for axis in dict.fromkeys(name for point, _ in points for name in point):
        others = {name: values for name, values in chosen.items() if name != axis}
        counted: Counter[str] = Counter()
        for point, episodes in points:
            if axis in point and _is_at(point, others):
                counted[json.dumps(point[axis])] += episodes
        for value in sorted(counted, key=_in_order):
            yield FacetValue(value=pair(axis, json.loads(value)), episodes=counted[value])


def _is_at(point: dict[str, Any], chosen: dict[str, list[str]]) -> bool:
    return all(
        name in point and pair(name, point[name]).partition("=")[2] in values
        for name, values in chosen.items()
    )
