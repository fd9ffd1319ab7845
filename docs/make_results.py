"""Writes the results of the study: from a server's ledger to numbers, from numbers to pages.

    .venv/bin/python -m docs.make_results               # the pages anew from docs/study
    .venv/bin/python -m docs.make_results build/study   # from what `make reproduce` left there

Runs that were published before stay beside those that are new, if they went on from the same first
phase: what was measured on one machine is not lost when another one goes on. `docs/study` has every
number: `results.json`, `times.json`, `curves`, and what other measurements put beside it
(`keyframes.json`, `oracles.json`). The pages follow from these files alone.
"""

import argparse
import json
import os
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from statistics import fmean
from typing import Any

from docs import (
    results_curves,
    results_documents,
    results_measured,
    results_orderings,
    results_page,
    results_words,
)
from docs.own_processes import ROOT
from docs.results_computed import CLOCKS, SEEK, TWIN, Computed
from docs.results_measured import REFERENCES, VERDICTS
from hide_tasks import load, suite
from seek_model.checkpoint_header import read_header
from seek_model.study import FULL, SPLIT, Study
from server import seeds, statistics
from server import tasks as catalogue
from server.latex import COLUMNS

STUDY = ROOT / "docs" / "study"
RESULTS, TIMES, CURVES, PLOT = "results.json", "times.json", "curves", "curves.svg"
PAGE, TABLE = "results.md", "table.md"
BEGIN, END = "<!-- results: written by docs/make_results.py -->", "<!-- /results -->"
Results = dict[str, Any]

# --- numbers ---


def collected(
    study: Study,
    out: Path,
    *,
    data: Path | None = None,
    first: Path | None = None,
    before: Results | None = None,
) -> Results:
    """Every number of a study.

    Args:
        study: full or tiny.
        out: the folder of `docs.reproduce`.
        data: of the server; default: in it.
        first: the shared first phase's weights; default: in it.
        before: numbers of the same study whose runs stay where there are none of this folder.
    """
    shared = _first(first or out / "runs/first/checkpoint-first.safetensors", out)
    records = results_measured.read(study, data or out / "data")
    for run in study.measured:
        if run.name in records:
            pace = results_curves.samples_per_second(results_curves.kept(out / "runs" / run.name))
            records[run.name]["samples_per_second"] = pace
    if before:
        shared, records = _beside_former(before, shared, records)
    tasks = shown(study)
    return {
        "study": study.name,
        "suite": f"{suite.SUITE} {suite.VERSION}",
        "split": SPLIT,
        "episodes": results_measured.episodes_of(study),
        "statistics": f"{statistics.METHOD}; {seeds.METHOD}",
        "tasks": {task: _task(task) for task in tasks},
        "first": shared,
        "runs": {run.name: records[run.name] for run in study.measured if run.name in records},
        "references": {name: records[name] for name in REFERENCES if name in records},
        **{verdict: computed(study, records, verdict, tasks) for verdict in VERDICTS},
    }


def shown(study: Study) -> list[str]:
    """A study's tasks in the paper's order."""
    wanted = results_measured.tasks_of(study)
    return [task for tasks in COLUMNS.values() for task in tasks if task in wanted]


def _task(name: str) -> Results:
    proof = catalogue.certificate(name)
    ceilings = {
        f"ceiling_{v}": proof and round(getattr(proof, f"ceiling_{v}"), 4) for v in VERDICTS
    }
    certificate = {"certificate": proof and proof.verdict}
    return {"category": str(load(name).category), **certificate, **ceilings}


def _first(path: Path, out: Path) -> Results | None:
    if not path.exists():
        return None
    header = read_header(path)
    return {
        "sha256": sha256(path.read_bytes()).hexdigest(),
        "parameters": header.parameters,
        "provenance": header.provenance.model_dump(mode="json"),
        "samples_per_second": results_curves.samples_per_second(
            results_curves.kept(out / "runs" / "first")
        ),
    }


def _beside_former(
    before: Results, shared: Results | None, records: Results
) -> tuple[Results | None, Results]:
    """The first phase and the records, former ones too where they are of the same first phase."""
    shared = shared or before["first"]
    former = dict(before["references"])
    for name, record in before["runs"].items():
        if shared and record["provenance"]["start"] == shared["sha256"]:
            former[name] = record
    if shared and before["first"] and shared["sha256"] == before["first"]["sha256"]:
        pace = shared["samples_per_second"] or before["first"]["samples_per_second"]
        shared = shared | {"samples_per_second": pace}
    return shared, former | records


def computed(study: Study, records: Results, verdict: str, tasks: Sequence[str]) -> Results:
    """What follows from the records of runs, by one verdict."""
    of = Computed(study, {name: records[name] for name in records if name not in REFERENCES},
                  verdict, tasks)  # fmt: skip
    return {
        "rates": {policy: of.rates(policy) for policy in of.played},
        "against_twin": of.differences(SEEK, TWIN),
        "seed_by_seed": of.seed_by_seed(SEEK, TWIN),
        "ablated": of.ablated(),
        "clocked": {"against": CLOCKS, "differences": of.clocked()},
        "orderings": results_orderings.orderings(of),
        "gains": results_orderings.gains(of),
    }


# --- times ---


def spent(out: Path) -> dict[str, dict[str, float]]:
    """Seconds that steps took, by kind and name."""
    return _json(out / TIMES) or {}


def times(out: Path, found: Results) -> dict[str, Any]:
    """Seconds of the machine that one step of each kind took, measured.

    Trainings know their own seconds, over all restarts. Those of a second phase count only where
    nothing else is known: others may have been trained beside it.
    """
    of_kind = {kind: dict(by_name) for kind, by_name in spent(out).items()}
    records = {"first": {"first": found["first"]}, "second": found["runs"]}
    for kind, of_runs in records.items():
        for name, record in of_runs.items():
            trained = record["provenance"]["seconds"] if record else 0.0
            known = of_kind.get(kind, {}).get(name, 0.0)
            if seconds := (known or trained) if kind == "second" else max(trained, known):
                of_kind.setdefault(kind, {})[name] = seconds
    rounded = {kind: round(fmean(of_kind[kind].values()), 1) for kind in sorted(of_kind)}
    return {"processors": os.cpu_count(), "seconds": rounded}


def expected_seconds(study: Study) -> dict[str, float]:
    """What is committed of it: seconds of one step of each kind."""
    return (_json(STUDY / TIMES) or {}).get(study.name, {}).get("seconds", {})


# --- files ---


def write(study: Study, out: Path, folder: Path, **where: Path | None) -> Results:
    """Numbers, curves and pages of a study into a folder of their own."""
    found = collected(study, out, **where)
    _write_numbers(study, out, folder, found)
    documents = results_documents.read(folder)
    (folder / PLOT).write_text(results_curves.plot(documents.curves))
    (folder / PAGE).write_text(results_page.page(documents, study))
    (folder / TABLE).write_text(results_page.table(documents))
    return found


def _write_numbers(study: Study, out: Path, folder: Path, found: Results) -> None:
    curves = folder / CURVES
    curves.mkdir(parents=True, exist_ok=True)
    (folder / RESULTS).write_text(text(found))
    for run in study.runs:
        if rows := results_curves.kept(out / "runs" / run.name):
            (curves / f"{run.name}.jsonl").write_text(results_curves.text(rows))
    _write_times(study, out, folder, found)


def _write_times(study: Study, out: Path, folder: Path, found: Results) -> None:
    """Beside what is there of other studies; kinds that were not measured this time stay."""
    known = _json(folder / TIMES) or {}
    before = known.get(study.name, {}).get("seconds", {})
    now = times(out, found)
    now["seconds"] = before | now["seconds"]
    (folder / TIMES).write_text(text(known | {study.name: now}))


def publish(study: Study, out: Path, **where: Path | None) -> None:
    """The same into this repository; of a study that is not the full one, how long it took."""
    found = collected(study, out, before=committed(study), **where)
    if study is FULL:
        _write_numbers(study, out, STUDY, found)
        render(ROOT)
    else:
        _write_times(study, out, STUDY, found)


def render(root: Path) -> None:
    """The pages of a repository from the numbers that are in it."""
    for name, content in pages(root).items():
        (root / name).write_text(content)


def pages(root: Path) -> dict[str, str]:
    """Every file that follows from docs/study, by its path."""
    documents = results_documents.read(root / "docs" / "study")
    before, rest = (root / "README.md").read_text().split(BEGIN)
    _, after = rest.split(END)
    return {
        f"docs/{PAGE}": results_page.page(documents, FULL, "study/"),
        f"docs/study/{PLOT}": results_curves.plot(documents.curves),
        "README.md": f"{before}{BEGIN}\n{results_page.table(documents)}{END}{after}",
    }


def text(document: Any) -> str:
    """A document as it is kept: one line for what is short."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _json(path: Path) -> Any:
    return json.loads(path.read_text()) if path.exists() else None


# --- beside what was expected ---


def committed(study: Study) -> Results | None:
    """The results of this study in the repository, if there are any."""
    found = _json(STUDY / RESULTS)
    return found if found and found["study"] == study.name else None


def beside(found: Results, expected: Results | None) -> list[str]:
    """The scores with their intervals, beside those that are committed."""
    lines = []
    for policy, name in ((SEEK, "SEEK"), (TWIN, "memory-free twin")):
        here, there = (_overall(one, policy) for one in (found, expected))
        lines.append(f"{name}: success {here}; expected {there}")
    return lines


def _overall(results: Results | None, policy: str) -> str:
    rates = results and results["success"]["rates"].get(policy)
    if not rates:
        return "not measured"
    one = rates["overall"]
    seeds_of = f"{one['seeds']} seed{'s' * (one['seeds'] != 1)}"
    return f"{results_words.rate(one)} % (n = {one['episodes']}, {seeds_of})"


def main() -> None:
    """Writes into the repository."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", nargs="?", type=Path, help="what `make reproduce` left")
    parser.add_argument("--data", type=Path, help="a server's data folder; default: OUT/data")
    parser.add_argument("--first", type=Path, help="the shared first phase's weights")
    given = parser.parse_args()
    if given.out:
        publish(FULL, given.out, data=given.data, first=given.first)
    else:
        render(ROOT)


if __name__ == "__main__":
    main()
