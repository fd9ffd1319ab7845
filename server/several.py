"""Two to six policies compared on the episodes that all of them played."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import load
from hide_tasks.contract import Category
from server import belief_scores, comparisons, facts, statistics
from server.models import Episode, Evaluation
from server.problems import invalid
from server.schemas.common import RatePublic, Verdict
from server.schemas.leaderboard import BeliefPublic
from server.schemas.several import (
    Entrant,
    Figures,
    Mean,
    PairComparison,
    SeveralComparison,
    SeveralEpisode,
    SeveralGroup,
    SeveralTask,
)
from server.states import EvaluationState
from server.statistics import Table
from server.suites import Place

FEWEST, MOST = 2, 6
Bools = NDArray[np.bool_]
Key = tuple[str, int]  # task, index


class _Row(NamedTuple):
    """An episode as one policy played it."""

    id: str
    success: bool
    exact: bool
    failure: str | None
    decisions: int
    scene: str


@dataclass(frozen=True)
class _Played:
    """The episodes that all played: one row per policy, one column per episode."""

    keys: list[Key]
    rows: list[list[_Row]]
    good: Bools  # by the comparison's verdict

    def of(self, category: Category | None = None, task: str | None = None) -> Bools:
        """The verdicts on a category's or a task's episodes, or on all."""
        if category is None and task is None:
            return self.good
        kinds = {name: load(name).category for name in self.tasks}
        wanted = [task in (None, name) and category in (None, kinds[name]) for name, _ in self.keys]
        return self.good[:, wanted]

    @property
    def tasks(self) -> list[str]:
        """By category, then by name."""
        order = list(Category)
        names = {task for task, _ in self.keys}
        return sorted(names, key=lambda name: (order.index(load(name).category), name))


def found(session: Session, texts: Sequence[str], place: Place) -> list[Evaluation]:
    """The evaluations that ids and policies' names stand for.

    Raises:
        Problem: 422, there is no such one, or the same twice; the field is `policy.N`, from 0.
    """
    require_count(len(texts))
    ones: list[Evaluation] = []
    for number, text in enumerate(texts):
        field = f"policy.{number}"
        one = comparisons.find(session, field, text, place)
        if one in ones:
            told = f"'{text}' is there already: it is {one.id}, the same as the {_nth(ones, one)}"
            raise invalid(field, told)
        ones.append(one)
    return ones


def suggested(session: Session, place: Place, *, limit: int = 200) -> list[Evaluation]:
    """The evaluation that stands for each of the latest policy versions; those of most first."""
    wanted = (
        select(Evaluation)
        .where(
            Evaluation.suite == place.suite,
            Evaluation.split == place.split,
            Evaluation.rules == "hide",
            Evaluation.state == EvaluationState.COMPLETED,
        )
        .order_by(Evaluation.id.desc())
        .limit(limit)
    )
    ones = sorted(session.scalars(wanted), key=comparisons.standing, reverse=True)
    first: dict[str, Evaluation] = {}
    for one in ones:
        first.setdefault(one.policy_version_id, one)
    return list(first.values())


def require_count(count: int) -> None:
    """Does nothing if as many can be compared.

    Raises:
        Problem: 422, they are too few or too many.
    """
    if not FEWEST <= count <= MOST:
        raise invalid("policy", f"give {FEWEST} to {MOST} policies or evaluations, not {count}")


def _nth(ones: Sequence[Evaluation], one: Evaluation) -> str:
    return ("first", "second", "third", "fourth", "fifth", "sixth")[ones.index(one)]


def compare(
    session: Session, ones: Sequence[Evaluation], *, verdict: Verdict = "success"
) -> SeveralComparison:
    """Completed evaluations on the episodes that all of them played.

    Raises:
        Problem: 409, they cannot be compared; it says why.
    """
    for other in ones[1:]:
        comparisons.require_comparable(ones[0], other)
    played = _played(session, ones, verdict)
    categories = {load(task).category for task in played.tasks}
    return SeveralComparison(
        policies=[_entrant(one) for one in ones],
        suite=f"{ones[0].suite} {ones[0].suite_version}",
        split=ones[0].split,
        rules=ones[0].rules,
        verdict=verdict,
        statistics=statistics.METHOD,
        other_sources=[task for task in played.tasks if _sources_differ(ones, task)],
        same_machine=all(one.machine == ones[0].machine for one in ones),
        overall=_group(played, None),
        categories={str(kind): _group(played, kind) for kind in Category if kind in categories},
        tasks=[_task(played, task) for task in played.tasks],
        figures=_figures(session, ones, played),
        episodes=_episodes(played),
    )


def _entrant(one: Evaluation) -> Entrant:
    known = facts.of_version(one.policy_version)
    return Entrant(**comparisons.compared(one).model_dump(), facts=known)


def _sources_differ(ones: Sequence[Evaluation], task: str) -> bool:
    return any(one.sources.get(task) != ones[0].sources.get(task) for one in ones)


def _played(session: Session, ones: Sequence[Evaluation], verdict: Verdict) -> _Played:
    columns = ("id", "success", "exact", "failure", "decisions", "scene_hash")
    by_key: dict[str, dict[Key, _Row]] = {one.id: {} for one in ones}
    wanted = select(
        Episode.evaluation_id,
        Episode.task,
        Episode.index,
        *(getattr(Episode, name) for name in columns),
    ).where(Episode.evaluation_id.in_(by_key))
    for evaluation, task, index, *row in session.execute(wanted):
        by_key[evaluation][task, index] = _Row(*row)
    keys = sorted(set.intersection(*(set(rows) for rows in by_key.values())))
    if not keys:
        raise comparisons.incomparable("they have no episode in common")
    rows = [[by_key[one.id][key] for key in keys] for one in ones]
    for key, *same in zip(keys, *rows, strict=True):
        if len({row.scene for row in same}) > 1:
            raise comparisons.incomparable(f"{key[0]} {key[1]} was not the same scene in all")
    good: Bools = np.array([[getattr(row, verdict) for row in line] for line in rows], dtype=bool)
    return _Played(keys, rows, good)


def _group(played: _Played, category: Category | None) -> SeveralGroup:
    good = played.of(category)
    return SeveralGroup(
        tasks=sum(category in (None, load(task).category) for task in played.tasks),
        episodes=good.shape[1],
        rates=_rates(good),
        ranks=statistics.rank_sets(good),
        pairs=_pairs(good),
    )


def _rates(good: Bools) -> list[RatePublic]:
    return [RatePublic.of(int(line.sum()), len(line)) for line in good]


def _pairs(good: Bools) -> list[PairComparison]:
    places = list(combinations(range(len(good)), 2))
    told = [comparisons.paired(table(good[one], good[other])) for one, other in places]
    adjusted = statistics.holm([one["p"] for one in told])
    return [
        PairComparison(first=first, second=second, p_holm=p, **one)
        for (first, second), one, p in zip(places, told, adjusted, strict=True)
    ]


def table(a: Bools, b: Bools) -> Table:
    """Episodes by what two policies made of them."""
    both, only_a, only_b = (a & b).sum(), (a & ~b).sum(), (~a & b).sum()
    return Table(int(both), int(only_a), int(only_b), len(a) - int(both + only_a + only_b))


def _task(played: _Played, task: str) -> SeveralTask:
    return SeveralTask(task=task, category=load(task).category, rates=_rates(played.of(task=task)))


def _figures(session: Session, ones: Sequence[Evaluation], played: _Played) -> list[Figures]:
    said = belief_scores.told(session, [one.id for one in ones])
    managed: list[bool] = np.all(played.good, axis=0).tolist()
    return [
        _figures_of(rows, managed, said[one.id])
        for one, rows in zip(ones, played.rows, strict=True)
    ]


def _figures_of(
    rows: Sequence[_Row], managed: Sequence[bool], belief: BeliefPublic | None
) -> Figures:
    count = len(rows)
    return Figures(
        success=RatePublic.of(sum(row.success for row in rows), count),
        exact=RatePublic.of(sum(row.exact for row in rows), count),
        gap=RatePublic.of(sum(row.success and not row.exact for row in rows), count),
        decisions=_mean([row.decisions for row in compress(rows, managed)]),
        belief=belief,
    )


def _mean(values: Sequence[int]) -> Mean:
    low, high = statistics.of_mean(values) or (None, None)
    value = sum(values) / len(values) if values else None
    return Mean(value=value, low=low, high=high, episodes=len(values))


def _episodes(played: _Played) -> list[SeveralEpisode]:
    order = {task: (place, load(task).category) for place, task in enumerate(played.tasks)}
    good_of_each: list[list[bool]] = np.transpose(played.good).tolist()
    columns = zip(played.keys, zip(*played.rows, strict=True), good_of_each, strict=True)
    told = [
        SeveralEpisode(
            task=task,
            category=order[task][1],
            index=index,
            episodes=[row.id for row in rows],
            managed=good,
            failures=[row.failure for row in rows],
        )
        for (task, index), rows, good in columns
    ]
    return sorted(told, key=lambda one: (order[one.task][0], one.index))
