"""The results pages: written from the numbers that are committed, and from nothing else."""

import json
import re
import xml.etree.ElementTree as Xml
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs import make_results, results_curves, results_documents, results_orderings, results_page
from docs.results_computed import LAID_OUT, Computed, policy_of
from hide_tasks.statistics import wilson
from seek_model.study import FULL
from tests.docs import studies
from tests.docs.studies import SMALL

ROOT = Path(__file__).parents[2]
LACKING = "seek-wcm-s0"
KEYFRAMES = {
    "seek": {
        "overall": {"frames": 90, "keyframe": 0.512, "position_near": 0.7},
        "tasks": {"reopen_drawer": {"frames": 30, "keyframe": 0.4, "position_near": 0.6}},
    }
}
ORACLES = {
    "seek": {
        "own": {"overall": [30, 75], "tasks": {"reopen_drawer": [5, 25]}},
        "true_counts": {"overall": [45, 75], "tasks": {"reopen_drawer": [6, 25]}},
    }
}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a study leaves of which one run was not evaluated."""
    folder = tmp_path_factory.mktemp("study")
    studies.measured(SMALL, folder / "data", without=(LACKING,))
    studies.trained(SMALL, folder)
    make_results.write(SMALL, folder, folder / "tables")
    return folder


@pytest.fixture
def results(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "tables" / "results.json").read_text())
    return found


@pytest.fixture
def page(out: Path) -> str:
    return (out / "tables" / "results.md").read_text()


def row(page: str, start: str) -> list[str]:
    """The cells of the first line of a table that starts so."""
    [line, *_] = [line for line in page.splitlines() if line.startswith(f"| {start}")]
    return [cell.strip() for cell in line.strip("|").split("|")]


# --- what is committed ---


@pytest.mark.parametrize("name", make_results.pages(ROOT))
def test_a_page_is_what_the_numbers_say(name: str) -> None:
    found = make_results.pages(ROOT)[name]

    assert (ROOT / name).read_text() == found, "run .venv/bin/python -m docs.make_results"
    if name.endswith("results.md"):
        for target in re.findall(r"\]\(([^)]+)\)", found):
            assert (ROOT / "docs" / target).exists(), target


def test_the_committed_numbers_follow_from_the_committed_outcomes() -> None:
    found = json.loads((make_results.STUDY / make_results.RESULTS).read_text())
    tasks = list(found["tasks"])

    assert found["study"] == FULL.name
    for verdict in ("success", "exact"):
        again = make_results.computed(FULL, found["runs"], verdict, tasks)
        assert json.loads(json.dumps(again)) == found[verdict]


# --- numbers ---


def test_every_run_that_was_played_is_there_with_its_seed_and_hash(results: dict[str, Any]) -> None:
    assert set(results["runs"]) == {run.name for run in SMALL.measured} - {LACKING}
    for name, record in results["runs"].items():
        assert record["provenance"]["seed"] == SMALL.run(name).seed
        assert re.fullmatch("[0-9a-f]{64}", record["sha256"])
        assert record["samples_per_second"] == 51.0
    assert set(results["references"]) == {"expert"}


def test_rates_are_those_of_the_episodes(results: dict[str, Any]) -> None:
    of_seeds = ["".join(results["runs"][f"twin-s{seed}"]["outcomes"]["success"].values())
                for seed in range(3)]  # fmt: skip

    found = results["success"]["rates"]["twin"]["overall"]

    good = "".join(of_seeds).count("1")
    assert (found["successes"], found["episodes"], found["seeds"]) == (good, 12, 3)
    assert found["value"] == pytest.approx(good / 36, abs=1e-4)
    low, high = wilson(good / 3, 12)  # type: ignore[arg-type]
    assert (found["low"], found["high"]) == pytest.approx((low, high), abs=1e-4)
    assert found["over_seeds"][0] < found["value"] < found["over_seeds"][1]


def test_differences_are_tested_and_corrected_over_the_tasks(results: dict[str, Any]) -> None:
    against = results["success"]["against_twin"]
    tests = [against[task] for task in SMALL.tasks]
    rates = results["success"]["rates"]

    expected = rates["seek"]["overall"]["value"] - rates["twin"]["overall"]["value"]
    assert against["overall"]["difference"] == pytest.approx(expected, abs=2e-4)
    assert min(test["p_holm"] for test in tests) == pytest.approx(
        3 * min(test["p"] for test in tests), rel=0.01
    )


def test_runs_of_the_same_seed_are_paired(results: dict[str, Any]) -> None:
    pairs = results["success"]["seed_by_seed"]

    assert [(one["a"], one["b"]) for one in pairs] == [
        (f"seek-s{seed}", f"twin-s{seed}") for seed in range(3)
    ]
    assert all(sum(one["table"].values()) == 12 for one in pairs)


def test_the_latest_evaluation_of_a_run_counts_not_the_best(tmp_path: Path) -> None:
    from hide_tasks.contract import Failure
    from server.blobs import Blobs
    from tests.server import ledgers

    run, data = SMALL.run("seek-s0"), tmp_path / "data"
    database, store = ledgers.opened(data, "sqlite"), Blobs(data / "blobs")
    version = ledgers.uploaded(database, store, "seek", studies.header(run), model=run.preset)
    wanted = {"tasks": list(SMALL.tasks), "episodes": SMALL.episodes}
    for failure in (None, Failure.UNDERCOUNT):
        ledgers.evaluated(database, store, version, lambda _, f=failure: f, **wanted)
    few = wanted | {"episodes": 1}
    ledgers.evaluated(database, store, version, lambda _: None, **few)
    database.close()

    found = make_results.collected(SMALL, tmp_path)

    assert found["success"]["rates"]["seek"]["overall"]["successes"] == 0


def test_what_another_folder_has_of_the_same_first_phase_stays(
    tmp_path: Path, results: dict[str, Any]
) -> None:
    studies.measured(SMALL, tmp_path / "data", without=tuple(results["runs"]))
    (tmp_path / "first").write_bytes(studies.header(SMALL.run("first")))

    found = make_results.collected(
        SMALL, tmp_path, first=tmp_path / "first", before=json.loads(json.dumps(results))
    )

    assert set(found["runs"]) == {run.name for run in SMALL.measured}
    assert found["first"]["samples_per_second"] == results["first"]["samples_per_second"] == 51.0
    assert found["success"]["rates"]["seek"] == results["success"]["rates"]["seek"]


def test_what_is_of_another_first_phase_goes(tmp_path: Path, results: dict[str, Any]) -> None:
    studies.measured(SMALL, tmp_path / "data", without=tuple(results["runs"]))
    results["first"]["sha256"] = "0" * 64
    for record in results["runs"].values():
        record["provenance"]["start"] = "0" * 64
    (tmp_path / "first").write_bytes(studies.header(SMALL.run("first")))

    found = make_results.collected(SMALL, tmp_path, first=tmp_path / "first", before=results)

    assert set(found["runs"]) == {LACKING}
    assert set(found["references"]) == {"expert"}


def test_a_second_phase_takes_what_it_took_of_the_machine(out: Path, tmp_path: Path) -> None:
    found = make_results.collected(SMALL, out)
    assert make_results.times(out, found)["seconds"]["second"] == 1800.0

    spent = {"first": {"first": 60.0}, "second": {run.name: 900.0 for run in SMALL.measured}}
    (tmp_path / "times.json").write_text(json.dumps(spent))

    assert make_results.times(tmp_path, found)["seconds"] == {"first": 1800.0, "second": 900.0}


# --- the page ---


def test_what_is_missing_is_told_with_the_command_that_fills_it(page: str) -> None:
    assert f"**Missing (– in the tables):** {LACKING}." in page
    assert ".venv/bin/python -m docs.reproduce" in page
    assert row(page, "WCM")[1:] == ["–"] * 4


def test_every_line_of_the_papers_tables_has_a_run() -> None:
    policies = {run.policy for run in FULL.measured}

    assert {policy_of(line.key) for block in LAID_OUT for line in block.rows} <= policies


def test_the_papers_figures_are_marked(page: str) -> None:
    assert row(page, "*the paper's SEEK, RLBench (CoppeliaSim)*")[1:5] == [
        "*62.9*", "*61.6*", "*59.2*", "*68.0*",
    ]  # fmt: skip
    assert page.count("another simulator (RLBench (CoppeliaSim)); not comparable") >= 3


def test_tasks_stand_with_their_ceilings(page: str, results: dict[str, Any]) -> None:
    ceiling = results["tasks"]["reopen_drawer"]["ceiling_success"]

    assert row(page, "reopen_drawer (HSR)")[5] == f"{100 * ceiling:.1f}"


def test_a_study_of_few_episodes_says_how_many(out: Path, page: str) -> None:
    assert "| success, % of 12 test episodes |" in (out / "tables" / "table.md").read_text()
    assert row(page, "seek-s0")[5] == "12"


def test_failures_are_counted_over_seeds_by_kind_and_by_task(
    page: str, results: dict[str, Any]
) -> None:
    total: dict[str, int] = {}
    for seed in range(3):
        for counted in results["runs"][f"twin-s{seed}"]["failures"].values():
            for name, count in counted.items():
                total[name] = total.get(name, 0) + count

    for name, count in total.items():
        assert row(page, f"{name} |")[2] == str(count)


def test_other_measurements_are_shown_where_they_are_there(out: Path, page: str) -> None:
    assert "Not measured yet: `docs/measure_keyframes.py`" in page
    documents = results_documents.read(out / "tables")

    shown = results_page.page(
        documents._replace(keyframes=KEYFRAMES, oracles=ORACLES), SMALL, "study/"
    )

    assert "Not measured yet" not in shown
    assert row(shown, "seek | 90")[2] == "51.2"
    assert row(shown, "seek | 40.0")[2].startswith("60.0 [")
    assert "| success, % | own | true counts |" in shown


def test_without_any_run_the_page_is_empty_and_says_so(tmp_path: Path) -> None:
    make_results.write(SMALL, tmp_path, tmp_path / "tables")

    page = (tmp_path / "tables" / "results.md").read_text()
    assert "seek-s0, seek-s1, seek-s2, twin-s0" in page
    assert row(page, "SEEK |")[1:] == ["–"] * 5


def test_of_another_study_only_its_times_are_published(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make_results, "STUDY", tmp_path)
    (tmp_path / "times.json").write_text('{"full": {"processors": 2, "seconds": {"first": 9.0}}}')

    make_results.publish(SMALL, out)

    assert [path.name for path in tmp_path.iterdir()] == ["times.json"]
    assert make_results.expected_seconds(FULL) == {"first": 9.0}
    assert make_results.expected_seconds(SMALL) == {"first": 1800.0, "second": 1800.0}


def test_a_score_stands_beside_the_expected_one(results: dict[str, Any]) -> None:
    [line, _] = make_results.beside(results, None)

    assert re.fullmatch(
        r"SEEK: success [\d.]+ \[\d+, \d+\] % \(n = 12, 3 seeds\); expected not measured", line
    )


# --- what the paper says ---


def made(**rates: float) -> Computed:
    """Policies that manage the same share of each task's episodes, the first ones."""
    records = {}
    for run in SMALL.measured:
        good = round(40 * rates.get(run.policy.replace("-", "_"), 0.5))
        outcomes = dict.fromkeys(SMALL.tasks, "1" * good + "0" * (40 - good))
        records[run.name] = {"outcomes": {"success": outcomes}}
    return Computed(SMALL, records, "success", SMALL.tasks)


def test_an_ordering_that_is_there_holds_and_is_shown() -> None:
    [first, *_] = results_orderings.orderings(made(seek=0.9, twin=0.2))

    assert (first["pairs"], first["as_published"], first["shown"], first["reversed"]) == (
        4,
        4,
        4,
        0,
    )


def test_an_ordering_the_other_way_round_is_contradicted() -> None:
    [first, *_] = results_orderings.orderings(made(seek=0.2, twin=0.9))

    assert (first["as_published"], first["shown"], first["reversed"]) == (0, 0, 4)


def test_equal_policies_bear_no_ordering_out() -> None:
    for one in results_orderings.orderings(made()):
        assert (one["as_published"], one["shown"], one["reversed"]) == (0, 0, 0)


def test_what_a_step_adds_most_is_told_beside_the_papers() -> None:
    [scm, *_] = results_orderings.gains(made(twin=0.2, seek_scm=0.6))

    assert scm["added"] == dict.fromkeys(("RC", "HSR", "EPT"), pytest.approx(0.4))
    assert scm["published"] == "RC"


# --- curves ---


def test_a_journal_is_thinned_and_keeps_its_validations(out: Path) -> None:
    kept = results_curves.read(out / "tables" / "curves")["seek-s0"]
    steps = [one for one in kept if one["kind"] == "step"]

    assert len(steps) == 120
    assert steps[-1]["step"] == 240
    assert [one["step"] for one in kept if one["kind"] == "validation"] == [120, 240]


def test_means_keep_the_mean() -> None:
    rows = [
        {"phase": "first", "step": step, "losses": {"total": float(step)}, "samples_per_second": 1}
        for step in range(1, 1001)
    ]

    thinned = results_curves.thinned(rows)

    assert len(thinned) == 100
    assert np.mean([one["losses"]["total"] for one in thinned]) == pytest.approx(500.5, rel=1e-3)


def test_the_plot_has_a_line_for_every_training(out: Path) -> None:
    drawn = Xml.parse(out / "tables" / "curves.svg").getroot()

    titles = [one.text for one in drawn.iter("{http://www.w3.org/2000/svg}title")]
    assert sorted(titles) == sorted(2 * [run.name for run in SMALL.runs])
