"""The files that the pages of results are made of."""

import json
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from docs import results_curves
from docs.results_words import NONE, Figures, interval, percent
from hide_tasks.statistics import wilson
from seek_model.study import Run
from server.ablation_rows import GROUPS


class Documents(NamedTuple):
    """What the pages are made of."""

    results: Figures
    times: Figures
    keyframes: Figures | None
    oracles: Figures | None
    curves: Mapping[str, list[results_curves.Row]]

    def rates(self, policy: str, verdict: str = "success") -> Figures:
        """Of a policy by group and task; empty if it was not measured."""
        return self.results[verdict]["rates"].get(policy, {})


def read(folder: Path) -> Documents:
    """The documents of a folder like docs/study."""

    def document(name: str) -> Any:
        path = folder / name
        return json.loads(path.read_text()) if path.exists() else None

    return Documents(
        document("results.json"),
        document("times.json") or {},
        document("keyframes.json"),
        document("oracles.json"),
        results_curves.read(folder / "curves"),
    )


def ceilings(results: Figures, verdict: str) -> dict[str, float | None]:
    """The most without memory, by group and task."""
    tasks = results["tasks"]
    found = {name: one[f"ceiling_{verdict}"] for name, one in tasks.items()}
    for group in GROUPS:
        of_group = [
            found[name] for name, one in tasks.items() if group in ("overall", one["category"])
        ]
        found[group] = None if None in of_group or not of_group else fmean(of_group)
    return found


def counted(documents: Documents, name: str, verdict: str, group: str) -> tuple[int, int]:
    """Successes and episodes of one run or reference policy, in a category or overall."""
    results = documents.results
    record = results["runs"].get(name) or results["references"].get(name)
    if not record:
        return 0, 0
    of_tasks = record["outcomes"][verdict].items()
    categories = {task: ("overall", one["category"]) for task, one in results["tasks"].items()}
    outcomes = "".join(each for task, each in of_tasks if group in categories[task])
    return outcomes.count("1"), len(outcomes)


def single(documents: Documents, name: str, verdict: str, group: str) -> str:
    """One run's rate with Wilson's interval."""
    good, count = counted(documents, name, verdict, group)
    return f"{percent(good / count)} {interval(wilson(good, count))}" if count else NONE


def record_of(documents: Documents, run: Run) -> Figures | None:
    """What is known of a training; None if nothing."""
    found = documents.results["runs"].get(run.name) if run.start else documents.results["first"]
    return found or None
