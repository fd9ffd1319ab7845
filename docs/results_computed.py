"""What follows from a study's outcomes: means over seeds, intervals, paired tests.

A pure function of the records, so whoever has `results.json` can compute it again.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hide_tasks import load
from seek_model.study import Run, Study
from server import comparisons, seeds, several, statistics
from server.ablation_rows import BASE, BLOCKS, GROUPS, WHOLE
from server.statistics import Table

Ints = NDArray[np.int64]
Figures = dict[str, Any]
SEEK, TWIN = "seek", "twin"
CLOCKS = {f"{SEEK}-clock": SEEK, f"{TWIN}-clock": TWIN}  # what each is tested against
LAID_OUT = tuple(block for block in BLOCKS if block.name != "choice")  # as in the paper


def policy_of(cell: str) -> str:
    """The study's policy of an ablation's cell."""
    return {WHOLE: SEEK, BASE: TWIN}.get(cell, f"{SEEK}-{cell.replace('_', '-')}")


class Played(NamedTuple):
    """One policy's outcomes: seeds × episodes."""

    runs: tuple[str, ...]
    good: Ints


class Computed:
    """The figures of one verdict.

    Args:
        study: which runs there are.
        records: of those that were measured, by name.
        verdict: success or exact.
        tasks: in the order in which they are shown.
    """

    def __init__(
        self, study: Study, records: Mapping[str, Figures], verdict: str, tasks: Sequence[str]
    ):
        self.study, self.tasks = study, tasks
        counts = {len(one["outcomes"][verdict][task]) for one in records.values() for task in tasks}
        each = counts.pop() if counts else 0
        self.episodes = [task for task in tasks for _ in range(each)]
        self.played: dict[str, Played] = {}
        for policy in dict.fromkeys(run.policy for run in study.measured):
            runs = [r.name for r in study.measured if r.policy == policy and r.name in records]
            if runs:
                rows = [_row(records[name]["outcomes"][verdict], tasks) for name in runs]
                self.played[policy] = Played(tuple(runs), np.array(rows))

    def mask(self, group: str) -> NDArray[np.bool_]:
        """Which episodes are of a category, of a task, or of all."""
        return np.array([group in ("overall", str(load(t).category), t) for t in self.episodes])

    def rates(self, policy: str) -> dict[str, Figures]:
        """Of each group and task, over a policy's seeds."""
        return {name: self._rate(policy, name) for name in (*GROUPS, *self.tasks)}

    def _rate(self, policy: str, group: str) -> Figures:
        mask = self.mask(group)
        good = self.played[policy].good[:, mask]
        low, high = statistics.of_shares(float(good.sum()) / len(good), good.shape[1])
        found = {
            "value": _rounded(good.mean()),
            "low": _rounded(low),
            "high": _rounded(high),
            "successes": int(good.sum()),
            "episodes": good.shape[1],
            "seeds": len(good),
        }
        if group == "overall":
            tasks = [task for task, there in zip(self.episodes, mask, strict=True) if there]
            found["over_seeds"] = _pair(seeds.interval(good, tasks))
        return found

    def difference(self, a: str, b: str, group: str) -> Figures:
        """How much one policy's mean is above another's, on the same episodes."""
        mask = self.mask(group)
        one, other = (self.played[name].good[:, mask] for name in (a, b))
        low, high = statistics.interval_of_means(one, other)
        flipped = len(other) * one.sum(axis=0) - len(one) * other.sum(axis=0)
        return {
            "difference": _rounded(one.mean() - other.mean()),
            "low": _rounded(low),
            "high": _rounded(high),
            "p": float(f"{statistics.sign_flip(flipped):.3g}"),
        }

    def differences(self, a: str, b: str) -> dict[str, Figures] | None:
        """Of each group and task, with Holm's correction over the tasks; None if one is missing."""
        if a not in self.played or b not in self.played:
            return None
        found = {group: self.difference(a, b, group) for group in GROUPS}
        of_tasks = {task: self.difference(a, b, task) for task in self.tasks}
        with_holm(of_tasks.values())
        one, other = (self.played[name].good for name in (a, b))
        found["overall"]["over_seeds"] = _pair(seeds.interval(one, self.episodes, other))
        return found | of_tasks

    def seed_by_seed(self, a: str, b: str) -> list[Figures]:
        """McNemar's test, Newcombe's interval and two bootstraps of runs of the same seed."""
        found = []
        for one, other in _same_seed(self.played, self.study, a, b):
            tables = [self._table(one, other, self.mask(task)) for task in self.tasks]
            summed = Table(*(sum(column) for column in zip(*tables, strict=True)))
            of_pair = comparisons.paired(summed)
            found.append(
                {
                    "a": one.name,
                    "b": other.name,
                    "table": summed._asdict(),
                    **{name: _rounded(of_pair[name]) for name in ("difference", "low", "high")},
                    **{name: float(f"{of_pair[name]:.3g}") for name in ("p", "p_exact")},
                    "over_episodes": _pair(statistics.over_episodes(tables)),
                    "over_tasks": _pair(statistics.over_tasks(tables)),
                }
            )
        return found

    def _table(self, a: Run, b: Run, mask: NDArray[np.bool_]) -> Table:
        rows = []
        for run in (a, b):
            played = self.played[run.policy]
            rows.append(played.good[played.runs.index(run.name)][mask] > 0)
        return several.table(*rows)

    def ablated(self) -> dict[str, dict[str, Figures]]:
        """Each ablation's difference from SEEK by group, with Holm's correction over them."""
        cells = dict.fromkeys(row.key for block in LAID_OUT for row in block.rows)
        wanted = [policy_of(cell) for cell in cells if cell != WHOLE]
        found = {
            policy: {group: self.difference(policy, SEEK, group) for group in GROUPS}
            for policy in wanted
            if policy in self.played and SEEK in self.played
        }
        for group in GROUPS:
            with_holm([one[group] for one in found.values()])
        return found

    def clocked(self) -> dict[str, dict[str, Figures]]:
        """What the logical clock changes, by group."""
        return {
            policy: {group: self.difference(policy, base, group) for group in GROUPS}
            for policy, base in CLOCKS.items()
            if policy in self.played and base in self.played
        }


def with_holm(tests: Iterable[Figures]) -> None:
    """Adds `p_holm` to tests that are made together."""
    there = list(tests)
    for one, p in zip(there, statistics.holm([one["p"] for one in there]), strict=True):
        one["p_holm"] = float(f"{p:.3g}")


def _row(outcomes: Mapping[str, str], tasks: Sequence[str]) -> list[int]:
    return [int(good) for task in tasks for good in outcomes[task]]


def _same_seed(
    played: Mapping[str, Played], study: Study, a: str, b: str
) -> Iterable[tuple[Run, Run]]:
    there = {
        (run.policy, run.seed): run
        for run in study.measured
        if run.policy in played and run.name in played[run.policy].runs
    }
    for (policy, seed), run in there.items():
        if policy == a and (b, seed) in there:
            yield run, there[b, seed]


def _pair(interval: tuple[float, float] | None) -> list[float] | None:
    return interval and [_rounded(end) for end in interval]


def _rounded(value: float) -> float:
    return round(float(value), 4)
