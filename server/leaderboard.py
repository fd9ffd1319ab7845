"""The leaderboard: complete evaluations of the whole suite, both verdicts, with intervals.

A policy version stands there with its latest complete evaluation, not its best: the best of many
tries is a lucky one. What covers less than the whole split is not shown at all.

It changes only when an evaluation is asked for or completed, so one that was computed is kept.
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import lru_cache, partial
from statistics import fmean

from sqlalchemy import Integer, cast, func, select
from sqlalchemy.orm import Session

from hide_tasks import SUITES, load, suite
from hide_tasks.contract import Category, Split
from server import belief_scores, facts, outcomes, ranks, tasks
from server.evaluations import Counts, verdicts
from server.models import Evaluation
from server.normalised import counting, normalised
from server.outcomes import Outcomes
from server.schemas.common import RatePublic, Verdict, Verdicts
from server.schemas.leaderboard import (
    BeliefPublic,
    Leaderboard,
    LeaderboardColumn,
    LeaderboardRow,
    NormalisedPublic,
)
from server.states import EvaluationState

ByTask = dict[str, Counts]
Read = Callable[[Session, Sequence[str]], dict[str, Outcomes]]
Measure = Callable[[dict[str, Verdicts]], NormalisedPublic | None]
MOST_KEPT = 32  # leaderboards: two verdicts of three splits, and some that are past
_kept: dict[Hashable, Leaderboard] = {}
_computing = threading.Lock()


def leaderboard(
    session: Session,
    *,
    split: Split = "test",
    verdict: Verdict = "success",
    of: str = suite.SUITE,
) -> Leaderboard:
    """The leaderboard of a suite's split, best first by a verdict; reference policies follow."""
    key = (of, split, verdict, standing(session, split))
    with _computing:  # once for all who ask
        found = _kept.get(key)
        if found is None:
            found = compute(session, split, verdict, of=of)
            if len(_kept) >= MOST_KEPT:
                _kept.clear()
            _kept[key] = found
    return found


def standing(session: Session, split: Split) -> Hashable:
    """What a leaderboard follows from: as long as this stays, so does the leaderboard."""
    done = Evaluation.state == EvaluationState.COMPLETED
    newest = select(
        func.max(Evaluation.id),
        func.count(),
        func.coalesce(func.sum(cast(done, Integer)), 0),
    )
    found = session.execute(newest.where(Evaluation.split == split)).one()
    return (suite.SUITE, suite.VERSION, *found)


def compute(
    session: Session,
    split: Split,
    verdict: Verdict,
    read: Read = outcomes.of_completed,
    of: str = suite.SUITE,
) -> Leaderboard:
    """The leaderboard anew, from outcomes that are kept or, with another reader, from the rows."""
    shown, others = _latest(session, split, of)
    played = read(session, [one.id for one in shown])
    said = belief_scores.told(session, [one.id for one in shown])
    measure = partial(normalised, ceilings=counting(columns(of), verdict), verdict=verdict)
    rows = [_row(one, _counted(played[one.id]), said[one.id], measure) for one in shown]
    rows.sort(key=lambda row: (row.reference, -(getattr(row.overall, verdict).value or 0.0)))
    return Leaderboard(
        suite=f"{of} {suite.VERSION}",
        split=split,
        verdict=verdict,
        columns=columns(of),
        ceilings=ceilings(verdict, of),
        rows=ranks.with_sets(list(ranks.numbered(rows, verdict)), played, verdict),
        unlisted=others,
    )


def columns(of: str = suite.SUITE) -> list[LeaderboardColumn]:
    """A suite's tasks by category."""
    return [
        LeaderboardColumn(task=one.name, category=one.category, certificate=one.certificate)
        for one in tasks.catalogue(of)
    ]


def ceilings(verdict: Verdict, of: str = suite.SUITE) -> dict[str, float | None]:
    """The most that is possible without memory: per task, per category, overall."""
    found: dict[str, float | None] = {}
    groups: dict[str, list[float | None]] = defaultdict(list)
    for column in columns(of):
        proof = column.certificate
        ceiling = getattr(proof, f"ceiling_{verdict}") if proof else None
        found[column.task] = ceiling
        for group in (str(column.category), "overall"):
            groups[group].append(ceiling)
    return found | {name: _mean(values) for name, values in groups.items()}


def _mean(values: Iterable[float | None]) -> float | None:
    known = list(values)
    return fmean(value for value in known if value is not None) if None not in known else None


def _latest(session: Session, split: Split, of: str) -> tuple[list[Evaluation], int]:
    """The latest whole evaluation of each policy version, and how many others there are."""
    of_split = (Evaluation.split == split) & (Evaluation.suite == of)
    known = select(Evaluation.policy_version_id, Evaluation.id, Evaluation.tasks).where(
        of_split,
        Evaluation.state == EvaluationState.COMPLETED,
        Evaluation.rules == "hide",
        Evaluation.suite_version == suite.VERSION,
        Evaluation.episodes == suite.SPLITS.get(split, 0),
    )
    whole = {
        version: id
        for version, id, tasks in session.execute(known.order_by(Evaluation.id))
        if set(tasks) == set(SUITES[of])
    }
    shown = session.scalars(select(Evaluation).where(Evaluation.id.in_(whole.values()))).all()
    count = session.scalar(select(func.count()).where(of_split)) or 0
    return sorted(shown, key=lambda one: one.id, reverse=True), count - len(shown)


def _counted(played: Outcomes) -> ByTask:
    counted = {}
    for task, part in _parts(played.episodes).items():
        success, exact = played.success[part], played.exact[part]
        counted[task] = Counts(len(success), len(success), 0, success.count(1), exact.count(1))
    return counted


@lru_cache(maxsize=64)
def _parts(episodes: tuple[tuple[str, int], ...]) -> dict[str, slice]:
    """Where each task's episodes stand among those of an evaluation."""
    tasks = [task for task, _ in episodes]
    firsts = {task: tasks.index(task) for task in dict.fromkeys(tasks)}
    return {task: slice(first, first + tasks.count(task)) for task, first in firsts.items()}


def _row(
    one: Evaluation, counted: ByTask, said: BeliefPublic | None, measure: Measure
) -> LeaderboardRow:
    assert one.ended is not None, "a completed evaluation has ended"
    groups = {
        str(name): together(c for task, c in counted.items() if load(task).category is name)
        for name in Category
    }
    by_task = {task: verdicts(c) for task, c in counted.items()}
    overall = together(counted.values())
    policy = one.policy_version.policy
    return LeaderboardRow(
        rank=None,
        rank_best=None,
        rank_worst=None,
        evaluation=one.id,
        policy=policy.name,
        version=one.policy_version.number,
        reference=one.policy_version.reference,
        ended=one.ended,
        tasks=by_task,
        categories=groups,
        overall=overall,
        policy_version=one.policy_version_id,
        owner=policy.owner and policy.owner.name,
        gap=gap(overall),
        normalised=measure(by_task),
        belief=said,
        facts=facts.of_version(one.policy_version),
    )


def gap(overall: Verdicts) -> RatePublic:
    """How often the checks held and yet something was wrong."""
    successes = overall.success.successes - overall.exact.successes
    return RatePublic.of(successes, overall.success.episodes)


def together(counted: Iterable[Counts]) -> Verdicts:
    """Both rates over several tasks' episodes; each task has as many, so each weighs the same."""
    return verdicts(Counts(*(sum(column) for column in zip(*counted, strict=True))))
