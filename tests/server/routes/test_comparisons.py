"""Several policies on the same episodes, over HTTP."""

import csv
import io
from collections.abc import Iterator
from typing import Any

import pytest

from hide_tasks import SUITES
from hide_tasks.contract import EpisodeSpec, Failure
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, create, hub_of, problem_of

SEVERAL = f"{API}/comparisons/several"
Site = tuple[TestClient, dict[str, str]]


def failing(below: int) -> ledgers.Outcomes:
    """Every episode with a smaller index fails."""
    return lambda spec: Failure.UNDERCOUNT if spec.index < below else None


def too_far(spec: EpisodeSpec) -> Failure | None:
    """All are managed, every other one not exactly."""
    return Failure.OVERCOUNT if spec.index % 2 else None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A server with whole evaluations of four policies, and a later part of the best."""
    with client(tmp_path_factory.mktemp("several")) as here:
        hub = hub_of(here)
        played = {"good": failing(2), "fair": failing(5), "poor": failing(20), "sloppy": too_far}
        ids = {}
        for name, outcomes in played.items():
            ledgers.registered(hub.database, name)
            ids[name] = ledgers.evaluated(hub.database, hub.blobs, name, outcomes)
        wanted = {"tasks": ["search_drawer"], "episodes": 2}
        ids["part"] = ledgers.evaluated(hub.database, hub.blobs, "good", **wanted)
        hard = {"suite": "hide-hard"}
        for name in ("good", "poor"):
            ids[f"hard {name}"] = ledgers.evaluated(
                hub.database, hub.blobs, name, played[name], **hard
            )
        yield here, ids


def compared(here: TestClient, *policies: str, **query: str) -> dict[str, Any]:
    answer = here.get(SEVERAL, params={"policy": policies, **query})
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def test_every_pair_is_tested_as_if_it_were_alone_but_for_holm(site: Site) -> None:
    here, _ = site

    found = compared(here, "good", "fair", "poor")

    for pair in found["overall"]["pairs"]:
        names = [found["policies"][pair[one]]["policy"] for one in ("first", "second")]
        params = dict(zip("ab", names, strict=True))
        alone = here.get(f"{API}/comparisons", params=params).json()["overall"]
        for name in ("a", "b", "table", "difference", "low", "high", "p", "p_exact"):
            assert pair[name] == alone[name], name
        assert pair["p"] <= pair["p_holm"] <= 3 * pair["p"]
    assert len(found["overall"]["pairs"]) == 3


def test_rank_sets_and_rates_are_given_together_and_by_category(site: Site) -> None:
    here, _ = site

    found = compared(here, "poor", "good", "fair", "sloppy")

    assert found["overall"]["ranks"] == [[4, 4], [2, 2], [3, 3], [1, 1]]
    assert [one["successes"] for one in found["overall"]["rates"]] == [
        len(SUITES["hide"]) * n for n in (5, 23, 20, 25)
    ]
    for group in found["categories"].values():
        assert (group["tasks"], group["episodes"], len(group["pairs"])) == (5, 125, 6)


def test_every_episode_says_who_managed_it_and_leads_to_each_run(site: Site) -> None:
    here, _ = site

    found = compared(here, "good", "poor")

    three = [one for one in found["episodes"] if one["index"] in (1, 10, 24)][:3]
    assert [one["managed"] for one in three] == [[False, False], [True, False], [True, True]]
    assert three[1]["failures"] == [None, "undercount"]
    for id, policy in zip(three[1]["episodes"], ("good", "poor"), strict=True):
        run = here.get(f"{API}/episodes/{id}").json()
        assert (run["policy"], run["task"], run["index"]) == (policy, three[1]["task"], 10)
    assert len(found["episodes"]) == 25 * len(SUITES["hide"])


def test_success_that_is_not_exact_is_the_gap(site: Site) -> None:
    here, _ = site

    figures = compared(here, "good", "sloppy")["figures"]

    assert [one["gap"]["successes"] for one in figures] == [0, 12 * len(SUITES["hide"])]
    assert [one["success"]["value"] for one in figures] == [pytest.approx(0.92), 1.0]
    both = 23 * len(SUITES["hide"])
    assert {one["decisions"]["episodes"] for one in figures} == {both}
    assert {one["decisions"]["value"] for one in figures} == {3.0}


def test_a_policy_stands_there_with_its_whole_evaluation_not_with_a_later_part(site: Site) -> None:
    here, ids = site

    found = compared(here, "good", "fair")
    of_part = compared(here, ids["part"], "fair")

    assert found["policies"][0]["evaluation"] == ids["good"]
    assert of_part["overall"]["episodes"] == 2


def test_the_same_twice_is_refused_whatever_it_is_called(site: Site) -> None:
    here, ids = site

    for same in ("good", "good@1", ids["good"]):
        answer = here.get(SEVERAL, params={"policy": ["good", "fair", same]})

        assert answer.status_code == 422
        [error] = problem_of(answer)["errors"]
        assert error["field"] == "policy.2" and "the same as the first" in error["message"]


def test_what_has_nothing_completed_says_what_there_is(site: Site) -> None:
    here, _ = site
    hub = hub_of(here)
    ledgers.evaluated(hub.database, hub.blobs, "noop", tasks=["search_drawer"], split="val")
    waiting = create(here, policy="noop")["id"]

    answer = here.get(SEVERAL, params={"policy": ["good", "noop"]})
    queued = here.get(SEVERAL, params={"policy": ["good", waiting]})

    [error] = problem_of(answer)["errors"]
    assert error["field"] == "policy.1"
    assert f"{waiting} is queued" in error["message"]
    assert error["message"].endswith("; there is one on hide, val")
    assert queued.status_code == 409 and "is queued" in problem_of(queued)["detail"]
    here.post(f"{API}/evaluations/{waiting}/cancellation")


def test_a_comparison_is_a_file_with_a_line_per_episode(site: Site) -> None:
    here, ids = site
    params = {"policy": ["good", "poor"], "format": "csv"}

    lines = list(csv.DictReader(io.StringIO(here.get(f"{SEVERAL}/export", params=params).text)))

    assert len(lines) == 25 * len(SUITES["hide"])
    assert {line["index"]: line["success poor@1"] for line in lines}["19"] == "false"
    params = {"policy": ["good", ids["part"]], "format": "csv"}
    twice = here.get(f"{SEVERAL}/export", params=params).text.splitlines()
    assert f"success good@1 {ids['part']}" in twice[0] and len(twice) == 3


def test_latex_has_the_papers_rows_and_every_pairs_test_as_a_comment(site: Site) -> None:
    here, _ = site
    params = {"policy": ["good", "poor"], "format": "latex"}

    lines = here.get(f"{SEVERAL}/export", params=params).text.splitlines()

    assert "good@1 less poor@1: +72.0 points" in lines[1] and lines[1].startswith("% ")
    assert lines[2].startswith("good@1 & 92.0 & ") and lines[3].startswith("poor@1 & 20.0 & ")
    assert here.get(f"{SEVERAL}/export", params=params | {"format": "json"}).json() == compared(
        here, "good", "poor"
    )


# --- other suites ---


def test_a_name_means_its_evaluation_of_one_suite(site: Site) -> None:
    here, ids = site

    usual, hard = compared(here, "good", "poor"), compared(here, "good", "poor", suite="hide-hard")

    for found, kind, suite in ((usual, "", "hide"), (hard, "hard ", "hide-hard")):
        assert [one["evaluation"] for one in found["policies"]] == [
            ids[f"{kind}good"], ids[f"{kind}poor"]
        ]  # fmt: skip
        assert found["suite"] == f"{suite} 1"
        assert {one["task"] for one in found["tasks"]} == set(SUITES[suite])
    params = {"a": "good", "b": "poor", "suite": "hide-hard"}
    two = here.get(f"{API}/comparisons", params=params).json()
    assert two["suite"] == "hide-hard 1" and two["a"]["evaluation"] == ids["hard good"]


def test_an_evaluation_of_another_suite_is_found_by_its_id(site: Site) -> None:
    here, ids = site
    both = ids["hard good"], ids["hard poor"]

    for suite in ("hide", "hide-hard", "real4"):
        assert compared(here, *both, suite=suite)["suite"] == "hide-hard 1"
    mixed = here.get(SEVERAL, params={"policy": ["good", ids["hard poor"]]})
    assert mixed.status_code == 409
    assert f"the suite of {ids['good']} is hide, of {ids['hard poor']} hide-hard" in mixed.text


def test_what_has_nothing_on_a_suite_says_on_which_it_has(site: Site) -> None:
    here, _ = site

    of_fair = here.get(SEVERAL, params={"policy": ["good", "fair"], "suite": "hide-hard"})
    of_good = here.get(SEVERAL, params={"policy": ["good", "poor"], "suite": "real4"})

    [fair], [good] = (problem_of(one)["errors"] for one in (of_fair, of_good))
    assert (fair["field"], good["field"]) == ("policy.1", "policy.0")
    assert fair["message"] == (
        "fair@1 has no completed evaluation on hide-hard, test; there is one on hide, test"
    )
    assert good["message"].endswith("there is one on hide, test and on hide-hard, test")


def test_a_file_of_another_suite_says_so_in_its_name_and_is_not_the_papers_table(
    site: Site,
) -> None:
    here, ids = site
    params = {"policy": [ids["hard good"], ids["hard poor"]]}

    usual = here.get(f"{SEVERAL}/export", params={"policy": ["good", "poor"]})
    lines = here.get(f"{SEVERAL}/export", params=params)
    refused = here.get(f"{SEVERAL}/export", params=params | {"format": "latex"})

    assert 'filename="comparison-test-success.csv"' in usual.headers["content-disposition"]
    told = lines.headers["content-disposition"]
    assert 'filename="comparison-hide-hard-test-success.csv"' in told
    assert len(lines.text.splitlines()) == 1 + 25 * len(SUITES["hide-hard"])
    [error] = problem_of(refused)["errors"]
    assert error["field"] == "format" and "of 'hide-hard' there are json, csv" in error["message"]
