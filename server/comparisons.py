"""Two policies compared on the episodes that both played.

Only what was played whole, under the same rules, on the same version of the suite is compared,
and every pair of episodes is the same scene.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session, aliased

from hide_tasks import load
from hide_tasks.contract import Category
from server import policies, statistics, suites
from server.models import Episode, Evaluation, PolicyVersion
from server.problems import Problem, invalid
from server.schemas.common import RatePublic, Verdict
from server.schemas.comparisons import (
    Compared,
    Comparison,
    Discordant,
    GroupComparison,
    PairedTable,
    TaskComparison,
)
from server.states import EvaluationState
from server.statistics import Table
from server.suites import Place


@dataclass(frozen=True)
class Pair:
    """An episode, played by both."""

    task: str
    index: int
    a: str  # ids
    b: str
    a_good: bool
    b_good: bool
    same_scene: bool


def compare(
    session: Session, a: Evaluation, b: Evaluation, *, verdict: Verdict = "success"
) -> Comparison:
    """Two completed evaluations on the episodes that both played.

    Raises:
        Problem: 409, they cannot be compared; it says why.
    """
    require_comparable(a, b)
    pairs = _pairs(session, a, b, verdict)
    by_task: dict[str, list[Pair]] = defaultdict(list)
    for pair in pairs:
        by_task[pair.task].append(pair)
    tables = {task: _table(found) for task, found in by_task.items()}
    return Comparison(
        a=compared(a),
        b=compared(b),
        suite=f"{a.suite} {a.suite_version}",
        split=a.split,
        rules=a.rules,
        verdict=verdict,
        statistics=statistics.METHOD,
        other_sources=[task for task in tables if a.sources.get(task) != b.sources.get(task)],
        same_machine=a.machine == b.machine,
        tasks=_tasks(tables),
        categories=_categories(tables),
        overall=_group(list(tables.values())),
        discordant=[_discordant(pair) for pair in pairs if pair.a_good != pair.b_good],
    )


def find(session: Session, field: str, text: str, place: Place) -> Evaluation:
    """The evaluation of this id, wherever it is, or the one that stands for a policy at a place.

    More episodes go before a later trial of fewer.

    Args:
        field: what to call it if it is wrong.

    Raises:
        Problem: 422, there is none.
    """
    if found := session.get(Evaluation, text):
        return found
    version = _version(session, field, text)
    if here := session.scalars(_completed(version.id, place)).all():
        return max(here, key=standing)
    raise invalid(field, _why_none(session, version, place))


def require_known(session: Session, field: str, text: str) -> None:
    """Does nothing if an evaluation or a policy is named, be it one that has played nothing.

    Raises:
        Problem: 422, neither is; it names the nearest.
    """
    if not session.get(Evaluation, text):
        _version(session, field, text)


def _version(session: Session, field: str, text: str) -> PolicyVersion:
    try:
        return policies.find(session, text)
    except Problem as problem:
        message = f"is no evaluation, and {problem.errors[0]['message']}"
        raise invalid(field, message) from None


def standing(one: Evaluation) -> tuple[bool, int, str]:
    """Which of a policy's evaluations stands for it: a whole one, then that of the most episodes,
    then the newest."""
    return suites.is_whole(one), len(one.tasks) * one.episodes, one.id


def others(session: Session, one: Evaluation) -> int:
    """How many more completed evaluations its policy has on its suite and split."""
    found = session.scalars(_completed(one.policy_version_id, place_of(one))).all()
    return sum(other.id != one.id for other in found)


def place_of(one: Evaluation) -> Place:
    """Where an evaluation is compared with others."""
    return Place(one.suite, one.split)


def _of_version(version: str) -> Select[Evaluation]:
    of_policy = Evaluation.policy_version_id == version
    return select(Evaluation).where(of_policy, Evaluation.rules == "hide")


def _completed(version: str, place: Place) -> Select[Evaluation]:
    completed = Evaluation.state == EvaluationState.COMPLETED
    here = (Evaluation.suite == place.suite) & (Evaluation.split == place.split)
    return _of_version(version).where(completed, here)


def _why_none(session: Session, version: PolicyVersion, place: Place) -> str:
    name = f"{version.policy.name}@{version.number}"
    others = session.scalars(_of_version(version.id).order_by(Evaluation.id.desc()).limit(50)).all()
    under_way = [one for one in others if place_of(one) == place]
    elsewhere = {place_of(one) for one in others if one.state == EvaluationState.COMPLETED}
    why = f"{name} has no completed evaluation on {place}"
    if under_way:
        why += f"; {under_way[0].id} is {under_way[0].state}"
    there = " and on ".join(map(str, sorted(elsewhere)))
    return f"{why}; there is one on {there}" if elsewhere else why


def require_comparable(a: Evaluation, b: Evaluation) -> None:
    """Does nothing if both are whole and played by the same rules on the same episodes.

    Raises:
        Problem: 409, they cannot be compared; it says why.
    """
    for one in (a, b):
        if one.state != EvaluationState.COMPLETED:
            raise incomparable(f"{one.id} is {one.state}; only what is completed is compared")
    for what in ("suite", "suite_version", "split", "rules"):
        first, second = getattr(a, what), getattr(b, what)
        if first != second:
            name = what.replace("_", " ")
            raise incomparable(f"the {name} of {a.id} is {first}, of {b.id} {second}")


def incomparable(why: str) -> Problem:
    """What is said of evaluations that cannot be compared."""
    return Problem(409, "not_comparable", f"These cannot be compared: {why}.")


def _pairs(session: Session, a: Evaluation, b: Evaluation, verdict: Verdict) -> list[Pair]:
    one, two = aliased(Episode), aliased(Episode)
    good = [getattr(side, verdict) for side in (one, two)]
    wanted = (
        select(one.task, one.index, one.id, two.id, *good, one.scene_hash == two.scene_hash)
        .join(two, (two.task == one.task) & (two.index == one.index))
        .where(one.evaluation_id == a.id, two.evaluation_id == b.id)
        .order_by(one.task, one.index)
    )
    pairs = [Pair(*row) for row in session.execute(wanted)]
    if not pairs:
        raise incomparable("they have no episode in common")
    for pair in pairs:
        if not pair.same_scene:
            raise incomparable(f"{pair.task} {pair.index} was another scene in each")
    return pairs


def _table(pairs: Sequence[Pair]) -> Table:
    counted = [0, 0, 0, 0]
    for pair in pairs:
        counted[2 * (not pair.a_good) + (not pair.b_good)] += 1
    return Table(*counted)


def _tasks(tables: dict[str, Table]) -> list[TaskComparison]:
    order = list(Category)
    rows: list[dict[str, Any]] = [
        {"task": task, "category": load(task).category, **paired(table)}
        for task, table in tables.items()
    ]
    adjusted = statistics.holm([row["p"] for row in rows])
    told = [TaskComparison(**row, p_holm=p) for row, p in zip(rows, adjusted, strict=True)]
    return sorted(told, key=lambda one: (order.index(one.category), one.task))


def _categories(tables: dict[str, Table]) -> dict[str, GroupComparison]:
    groups: dict[str, list[Table]] = {}
    for category in Category:
        if found := [one for task, one in tables.items() if load(task).category is category]:
            groups[str(category)] = found
    return {name: _group(found) for name, found in groups.items()}


def _group(tables: Sequence[Table]) -> GroupComparison:
    """Several tasks together; each has as many episodes, so each weighs the same."""
    summed = Table(*(sum(column) for column in zip(*tables, strict=True)))
    return GroupComparison(
        **paired(summed),
        tasks=len(tables),
        over_episodes=statistics.over_episodes(tables),
        over_tasks=statistics.over_tasks(tables),
    )


def paired(table: Table) -> dict[str, Any]:
    """The fields of `schemas.Paired`."""
    low, high = statistics.interval(table)
    return {
        "a": RatePublic.of(table.both + table.only_a, table.episodes),
        "b": RatePublic.of(table.both + table.only_b, table.episodes),
        "table": PairedTable(**table._asdict()),
        "difference": table.difference,
        "low": low,
        "high": high,
        "p": float(statistics.mcnemar(table.only_a, table.only_b)),
        "p_exact": float(statistics.mcnemar(table.only_a, table.only_b, exact=True)),
    }


def compared(one: Evaluation) -> Compared:
    """An evaluation as a side of a comparison."""
    version = one.policy_version
    return Compared(evaluation=one.id, policy=version.policy.name, version=version.number)


def _discordant(pair: Pair) -> Discordant:
    return Discordant(
        task=pair.task,
        index=pair.index,
        better="a" if pair.a_good else "b",
        a=pair.a,
        b=pair.b,
    )
