"""Memory's length, content and components: the paper's ablations, from this server's evaluations.

A policy stands in the cell that its checkpoint's configuration says. Each version counts with its
latest whole evaluation; the mean over versions is given, and each of them.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import load, suite
from hide_tasks.contract import Split
from seek_model.presets import CLOCK
from server import comparisons, facts, outcomes, statistics, suites
from server.ablation_rows import BLOCKS, GROUPS, Block, Row, Size, cell_of, preset_of, size_of
from server.models import Evaluation
from server.schemas.ablations import (
    AblationBlock,
    AblationRow,
    Ablations,
    AblationTest,
    AblationVersion,
    MeanRate,
)
from server.schemas.common import RatePublic, Verdict
from server.schemas.policies import PolicyFacts
from server.states import EvaluationState

Bools = NDArray[np.bool_]


class _Measured(NamedTuple):
    """A version's evaluation, and its verdicts: one per episode, the same order for all."""

    evaluation: Evaluation
    facts: PolicyFacts
    cell: str
    good: Bools


class Asked(NamedTuple):
    """Of which evaluations."""

    split: Split = "test"
    verdict: Verdict = "success"
    size: Size = "small"
    clock: bool = False  # told the number of the decision


def ablations(session: Session, asked: Asked) -> Ablations:
    """Every block, measured or not."""
    known = _known(session, asked.split)
    wanted = [one for one, said in known if _place(said) == place_of(asked.size, asked.clock)]
    measured = _measured(session, wanted, asked.verdict)
    groups = _groups(session, measured)
    by_cell: dict[str, list[_Measured]] = defaultdict(list)
    for one in measured:
        by_cell[one.cell].append(one)
    return Ablations(
        suite=f"{suite.SUITE} {suite.VERSION}",
        split=asked.split,
        verdict=asked.verdict,
        size=asked.size,
        clock=asked.clock,
        statistics=statistics.METHOD,
        measured=len(measured),
        places=Counter(_place(said) for _, said in known),
        blocks=[_Made(asked, by_cell, groups).block(block) for block in BLOCKS],
    )


def standing(session: Session, split: Split) -> list[str]:
    """What the ablations follow from: as long as this stays, so do they."""
    return [one.id for one, _ in _known(session, split)]


def place_of(size: str, clock: bool) -> str:
    """What `places` calls models of a size, with or without the clock."""
    return size + CLOCK * clock


def _place(said: PolicyFacts) -> str:
    return place_of(str(size_of(said)), bool(said.clock))


def _known(session: Session, split: Split) -> list[tuple[Evaluation, PolicyFacts]]:
    """The latest whole evaluation of each version that has a cell."""
    wanted = select(Evaluation).where(
        Evaluation.split == split,
        Evaluation.rules == "hide",
        Evaluation.state == EvaluationState.COMPLETED,
        Evaluation.suite == suite.SUITE,
        Evaluation.suite_version == suite.VERSION,
        Evaluation.episodes == suite.SPLITS[split],
    )
    latest: dict[str, Evaluation] = {}
    for one in session.scalars(wanted.order_by(Evaluation.id)):
        if suites.is_whole(one):
            latest[one.policy_version_id] = one
    told = [(one, facts.of_version(one.policy_version)) for one in latest.values()]
    return [(one, said) for one, said in told if cell_of(said)]


def _measured(session: Session, ones: Sequence[Evaluation], verdict: Verdict) -> list[_Measured]:
    played = outcomes.of_completed(session, [one.id for one in ones])
    told = []
    for one in ones:
        said = facts.of_version(one.policy_version)
        good = np.frombuffer(getattr(played[one.id], verdict), dtype=bool)
        told.append(_Measured(one, said, cell_of(said) or "", good))
    return told


def _groups(session: Session, measured: Sequence[_Measured]) -> dict[str, Bools]:
    """Which episodes are of which category; whole evaluations have the same ones."""
    if not measured:
        return {}
    [played] = outcomes.of_completed(session, [measured[0].evaluation.id]).values()
    kinds = [load(task).category.value for task, _ in played.episodes]
    return {name: np.array([name in ("overall", kind) for kind in kinds]) for name in GROUPS}


class _Made:
    """The blocks of what was measured."""

    def __init__(self, asked: Asked, by_cell: dict[str, list[_Measured]], groups: dict[str, Bools]):
        self.asked, self.by_cell, self.groups = asked, by_cell, groups

    def block(self, block: Block) -> AblationBlock:
        rows = [self._row(row) for row in (*block.rows, *self._lengths(block))]
        if block.name == "length":
            rows.sort(key=_length)
        tested = [row for row in rows if row.tests is not None]
        for group in GROUPS:
            tests = [row.tests[group] for row in tested if row.tests]
            for one, p in zip(tests, statistics.holm([one.p for one in tests]), strict=True):
                one.p_holm = float(p)
        return AblationBlock(name=block.name, title=block.title, rows=rows)

    def _lengths(self, block: Block) -> list[Row]:
        """Lengths that were measured and are none of the paper's."""
        known = {row.key for row in block.rows}
        if block.name != "length":
            return []
        keys = [key for key in self.by_cell if key.startswith("length_") and key not in known]
        return [Row(key, key.removeprefix("length_"), "length_0") for key in keys]

    def _row(self, row: Row) -> AblationRow:
        there = self.by_cell.get(row.key, [])
        other = self.by_cell.get(row.against or "", [])
        return AblationRow(
            key=row.key,
            label=row.label,
            preset=preset_of(row.key, self.asked.size, clock=self.asked.clock),
            published=row.published,
            published_steps=row.steps,
            versions=[self._version(one) for one in there],
            rates={name: self._mean(there, name) for name in GROUPS} if there else None,
            against=row.against,
            tests={name: self._test(there, other, name) for name in GROUPS}
            if there and other
            else None,
        )

    def _version(self, one: _Measured) -> AblationVersion:
        named = comparisons.compared(one.evaluation).model_dump()
        chosen = {name: one.good[these] for name, these in self.groups.items()}
        rates = {name: RatePublic.of(int(good.sum()), len(good)) for name, good in chosen.items()}
        return AblationVersion(**named, facts=one.facts, rates=rates)

    def _mean(self, there: Sequence[_Measured], group: str) -> MeanRate:
        good = [one.good[self.groups[group]] for one in there]
        rates, count = [float(one.mean()) for one in good], len(good[0])
        low, high = statistics.of_shares(sum(int(one.sum()) for one in good) / len(good), count)
        return MeanRate(
            value=fmean(rates),
            low=low,
            high=high,
            episodes=count,
            versions=len(rates),
            least=min(rates),
            most=max(rates),
        )

    def _test(
        self, there: Sequence[_Measured], other: Sequence[_Measured], group: str
    ) -> AblationTest:
        a, b = (
            np.array([one.good[self.groups[group]] for one in ones], dtype=np.int64)
            for ones in (there, other)
        )
        low, high = statistics.interval_of_means(a, b)
        p = statistics.sign_flip(len(b) * a.sum(axis=0) - len(a) * b.sum(axis=0))
        difference = float(a.mean() - b.mean())
        return AblationTest(difference=difference, low=low, high=high, p=p, p_holm=p)


def _length(row: AblationRow) -> int:
    return int(row.label)
