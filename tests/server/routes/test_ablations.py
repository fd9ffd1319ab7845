"""The ablations over HTTP: which checkpoint stands where, and what is tested against what."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hide_tasks.contract import EpisodeSpec, Failure
from seek_model.presets import ABLATIONS, NAMES, preset
from server import ablation_rows, checkpoints, facts
from server.checkpoints import Received
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, hub_of

Site = tuple[TestClient, dict[str, str]]


def failing(*indices: int) -> ledgers.Outcomes:
    """Fails the episodes of these indices."""

    def outcome(spec: EpisodeSpec) -> Failure | None:
        return Failure.UNDERCOUNT if spec.index in indices else None

    return outcome


def uploaded(here: TestClient, model: str, outcomes: ledgers.Outcomes, **wanted: Any) -> str:
    """A checkpoint's evaluation; each one is a version of its own."""
    hub = hub_of(here)
    name = model.replace("/", "-").replace("+", "-")
    ledgers.uploaded(hub.database, hub.blobs, name, b"weights", model=model)
    return ledgers.evaluated(hub.database, hub.blobs, name, outcomes, **wanted)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A server that measured a few cells; two versions of the model itself."""
    with client(tmp_path_factory.mktemp("ablations")) as here:
        made = {
            "none": uploaded(here, "sam2act-small", failing(*range(15))),
            "seek": uploaded(here, "seek-small", failing(0)),
            "again": uploaded(here, "seek-small", failing(0, 1, 2)),
            "length_0": uploaded(here, "seek-small/length_0", failing(*range(8))),
            "length_4": uploaded(here, "seek-small/length_4", failing(0, 1, 2)),
            "clock": uploaded(here, "seek-small+clock", failing()),
            "other": uploaded(here, "sam2act_plus-small", failing()),
            "anchor_first": uploaded(here, "seek-small/anchor_first", failing(3)),
        }
        wanted = {"tasks": ["search_drawer"], "episodes": 5}
        made["part"] = uploaded(here, "seek-small/scm", failing(), **wanted)
        yield here, made


def found(here: TestClient, **query: str) -> dict[str, Any]:
    answer = here.get(f"{API}/ablations", params=query)
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def rows(here: TestClient, block: str, **query: str) -> dict[str, dict[str, Any]]:
    """The lines of a block by their keys."""
    [one] = [one for one in found(here, **query)["blocks"] if one["name"] == block]
    return {row["key"]: row for row in one["rows"]}


@pytest.mark.parametrize("size", ["small", "paper"])
def test_every_ablation_of_the_presets_has_a_cell_and_names_itself_to_be_trained(
    size: Any,
) -> None:
    keys = {row.key for block in ablation_rows.BLOCKS for row in block.rows}
    named = {ablation_rows.preset_of(key, size, clock=False) for key in keys}

    assert keys == {*ABLATIONS, "none", "seek"}
    for name in named:
        assert name in NAMES
        cell = ablation_rows.cell_of(facts.of_config(preset(name)))
        assert ablation_rows.preset_of(cell or "", size, clock=False) == name


def test_the_papers_columns_are_the_means_of_its_categories() -> None:
    for block in ablation_rows.BLOCKS:
        for row in block.rows:
            if row.published:
                mean = sum(row.published[kind] for kind in ("RC", "HSR", "EPT")) / 3
                assert row.published["overall"] == pytest.approx(mean, abs=0.11)


def test_a_checkpoint_stands_where_its_configuration_says(site: Site) -> None:
    here, made = site

    for block, keys in (("length", ("length_0", "length_4", "seek")), ("single", ("none",))):
        there = rows(here, block)
        for key in keys:
            assert made[key] in [one["evaluation"] for one in there[key]["versions"]]
    assert rows(here, "choice")["anchor_first"]["versions"][0]["evaluation"] == made["anchor_first"]
    assert made["other"] not in str(found(here))


def test_a_length_without_a_preset_has_a_line_of_its_own(tmp_path: Path) -> None:
    with client(tmp_path) as here:
        hub = hub_of(here)
        config = preset("seek-small")
        memory = config.model.memory
        assert memory
        model = config.model.model_copy(update={"memory": memory.model_copy(update={"window": 3})})
        config = config.model_copy(update={"model": model})
        received = Received(Path(), hub.blobs.put(b"weights"), 7)
        with hub.database.writing() as session:
            checkpoints.keep(
                session, received, name="three", description="", config=config, checks=()
            )
        ledgers.evaluated(hub.database, hub.blobs, "three", failing(0))

        lines = rows(here, "length")

        assert [row["label"] for row in lines.values()] == ["0", "2", "3", "4", "6"]
        assert lines["length_3"]["preset"] is None and lines["length_3"]["published"] is None
        assert lines["length_3"]["rates"]["overall"]["value"] == pytest.approx(24 / 25)


def test_several_versions_are_meant_and_each_is_listed(site: Site) -> None:
    here, made = site

    row = rows(here, "length")["seek"]

    assert [one["evaluation"] for one in row["versions"]] == [made["seek"], made["again"]]
    overall = row["rates"]["overall"]
    assert overall["value"] == pytest.approx((24 + 22) / 50)
    assert (overall["least"], overall["most"]) == (pytest.approx(22 / 25), pytest.approx(24 / 25))
    assert (overall["episodes"], overall["versions"]) == (375, 2)
    assert overall["low"] < overall["value"] < overall["high"]


def test_one_version_against_one_is_tested_as_any_two_policies_are(site: Site) -> None:
    here, made = site
    params = {"a": made["length_4"], "b": made["length_0"]}
    alone = here.get(f"{API}/comparisons", params=params).json()

    tests = rows(here, "length")["length_4"]["tests"]

    for group, told in (("overall", alone["overall"]), ("HSR", alone["categories"]["HSR"])):
        for name in ("difference", "low", "high", "p"):
            assert tests[group][name] == pytest.approx(told[name], rel=1e-6, abs=1e-12), name
    assert tests["overall"]["p"] <= tests["overall"]["p_holm"] <= 2 * tests["overall"]["p"] + 1e-9


def test_what_is_not_whole_is_not_shown_and_an_empty_cell_says_what_to_train(site: Site) -> None:
    here, _ = site

    row = rows(here, "progressive")["scm"]

    assert row["versions"] == [] and row["rates"] is None and row["tests"] is None
    assert row["preset"] == "seek-small/scm"
    assert row["published_steps"] == {"RC": 14.0}


def test_policies_with_the_clock_stand_apart(site: Site) -> None:
    here, made = site

    told = rows(here, "length", clock="true")["seek"]

    assert [one["evaluation"] for one in told["versions"]] == [made["clock"]]
    assert told["preset"] == "seek-small+clock"
    assert found(here)["places"] == {"small": 6, "small+clock": 1}


def test_the_ablations_are_files(site: Site) -> None:
    here, made = site

    text = here.get(f"{API}/ablations/export", params={"format": "csv"}).text
    latex = here.get(f"{API}/ablations/export", params={"format": "latex"}).text

    lines = {(one["block"], one["key"]): one for one in csv.DictReader(io.StringIO(text))}
    whole = lines["length", "seek"]
    assert whole["evaluations"] == f"{made['seek']} {made['again']}"
    assert float(whole["overall_value"]) == pytest.approx(0.92)
    assert (whole["overall_published"], whole["against"]) == ("62.9", "length_0")
    assert lines["length", "length_2"]["overall_value"] == ""
    assert r" & 2 & -- & -- & -- & -- \\ % paper 53.7 / 44.2 / 51.8 / 65.0" in latex
    assert r" & 6 & 92.0 & 92.0 & 92.0 & 92.0 \\ % n 375, versions 2; paper 62.9" in latex
    json = here.get(f"{API}/ablations/export", params={"format": "json"}).json()
    assert json == found(here)
