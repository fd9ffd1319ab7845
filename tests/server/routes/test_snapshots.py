"""Snapshots of the leaderboard and comparisons over HTTP."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import select

from hide_tasks import SUITES
from hide_tasks.contract import EpisodeSpec, Failure
from server import lifecycle
from server.models import Evaluation, Shard
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, create, hub_of, problem_of
from tests.server.people import peopled, token_of, visitor

SNAPSHOTS = f"{API}/leaderboard/snapshots"


def failing(below: int) -> ledgers.Outcomes:
    """Every episode with a smaller index fails."""
    return lambda spec: Failure.UNDERCOUNT if spec.index < below else None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[TestClient, dict[str, str]]]:
    """A server with whole evaluations of three policies, and a part of one."""
    with client(tmp_path_factory.mktemp("snapshots")) as here:
        hub = hub_of(here)
        ids = {}
        for name, below in (("good", 2), ("fair", 5), ("poor", 20)):
            ledgers.registered(hub.database, name)
            ids[name] = ledgers.evaluated(hub.database, hub.blobs, name, failing(below))
        wanted = {"tasks": ["search_drawer", "push_button_times"], "episodes": 5}
        ids["part"] = ledgers.evaluated(hub.database, hub.blobs, "poor", odd, **wanted)
        yield here, ids


def odd(spec: EpisodeSpec) -> Failure | None:
    return Failure.UNDERCOUNT if spec.index % 2 else None


# --- snapshots ---


def test_a_snapshot_is_kept_to_the_byte_under_its_hash(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, ids = site
    taken = here.post(SNAPSHOTS, json={"note": "for the paper"})

    kept = taken.json()
    content = here.get(kept["content"])
    assert taken.status_code == 201
    assert here.get(taken.headers["location"]).json() == kept
    assert here.get(f"{SNAPSHOTS}/{kept['sha256']}").json() == kept
    assert hashlib.sha256(content.content).hexdigest() == kept["sha256"]
    assert kept["note"] == "for the paper" and kept["owner"] == "owner"
    rows = content.json()["leaderboards"]["success"]["rows"]
    assert [row["policy"] for row in rows] == ["good", "fair", "poor"]
    rests_on = {one["evaluation"] for one in content.json()["evaluations"]}
    assert rests_on == {ids["good"], ids["fair"], ids["poor"]}


def test_a_snapshot_tells_the_hash_of_what_its_rows_rest_on(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, ids = site
    number = here.post(SNAPSHOTS, json={}).json()["number"]
    found = here.get(f"{SNAPSHOTS}/{number}/content.json").json()
    with hub_of(here).database.reading() as session:
        lines = "".join(
            f"{one.task} {one.index} {one.digest}\n"
            for one in ledgers.episodes_of(session, ids["fair"])
        )

    results = {one["evaluation"]: one["results"] for one in found["evaluations"]}
    assert results[ids["fair"]] == hashlib.sha256(lines.encode()).hexdigest()
    assert len(set(results.values())) == 3


def test_the_same_standing_is_the_same_snapshot(site: tuple[TestClient, dict[str, str]]) -> None:
    here, _ = site

    first, again = (here.post(SNAPSHOTS, json={"note": note}) for note in ("one", "two"))

    assert again.status_code == 200
    assert again.json() == first.json()


def test_a_snapshot_stays_while_the_leaderboard_moves(tmp_path: Path) -> None:
    with client(tmp_path) as here:
        hub = hub_of(here)
        ledgers.registered(hub.database, "mine")
        ledgers.evaluated(hub.database, hub.blobs, "mine", failing(20))
        before = here.post(SNAPSHOTS, json={}).json()
        content = here.get(before["content"]).content
        ledgers.evaluated(hub.database, hub.blobs, "mine", failing(1))

        later = here.post(SNAPSHOTS, json={}).json()
        listed = here.get(SNAPSHOTS, params={"split": "test"}).json()["items"]

        assert here.get(before["content"]).content == content
        assert later["sha256"] != before["sha256"]
        assert [one["number"] for one in listed] == [later["number"], before["number"]]
        assert here.get(SNAPSHOTS, params={"split": "val"}).json()["items"] == []


def test_a_snapshot_is_of_one_suite(tmp_path: Path) -> None:
    with client(tmp_path) as here:
        hub = hub_of(here)
        ledgers.registered(hub.database, "mine")
        whole = {
            name: ledgers.evaluated(hub.database, hub.blobs, "mine", failing(9), suite=asked)
            for name, asked in (("hide", "full"), ("hide-hard", "hide-hard"))
        }

        usual = here.post(SNAPSHOTS, json={}).json()
        hard, again = (here.post(SNAPSHOTS, json={"suite": "hide-hard"}) for _ in range(2))

        assert (usual["suite"], hard.json()["suite"]) == ("hide", "hide-hard")
        assert again.status_code == 200 and again.json() == hard.json()
        for one in (usual, hard.json()):
            found = here.get(one["content"]).json()
            assert {board["suite"] for board in found["leaderboards"].values()} == {
                f"{one['suite']} 1"
            }
            columns = found["leaderboards"]["exact"]["columns"]
            assert {column["task"] for column in columns} == set(SUITES[one["suite"]])
            rests_on = [row["evaluation"] for row in found["evaluations"]]
            assert rests_on == [whole[one["suite"]]]
            listed = here.get(SNAPSHOTS, params={"suite": one["suite"]}).json()["items"]
            assert listed == [one]
        assert len(here.get(SNAPSHOTS).json()["items"]) == 2
        empty = here.post(SNAPSHOTS, json={"suite": "real4"})
        assert empty.status_code == 409
        assert "No policy has a whole evaluation on real4, test" in problem_of(empty)["detail"]


def test_a_snapshot_of_suite_hide_says_what_it_always_said(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, _ = site

    kept = here.post(SNAPSHOTS, json={}).json()
    found = here.get(kept["content"]).json()

    assert set(found) == {
        "format", "software", "statistics", "episodes", "leaderboards", "evaluations"
    }  # fmt: skip
    assert found["format"] == 1
    assert found["leaderboards"]["success"]["suite"] == "hide 1"


def test_nothing_is_no_snapshot(site: tuple[TestClient, dict[str, str]]) -> None:
    here, _ = site

    answer = here.post(SNAPSHOTS, json={"split": "val"})

    assert answer.status_code == 409 and problem_of(answer)["code"] == "empty"


def test_maintainers_take_snapshots(tmp_path: Path) -> None:
    with peopled(tmp_path) as app:
        asked = {
            name: visitor(app, token_of(app, name)).post(SNAPSHOTS, json={}).status_code
            for name in ("viewer", "submitter", "maintainer")
        }

    assert asked == {"viewer": 403, "submitter": 403, "maintainer": 409}


def test_the_leaderboard_tells_which_ranks_chance_leaves_open(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, _ = site

    rows = here.get(f"{API}/leaderboard").json()["rows"]

    told = {row["policy"]: (row["rank"], row["rank_best"], row["rank_worst"]) for row in rows}
    assert told == {"good": (1, 1, 1), "fair": (2, 2, 2), "poor": (3, 3, 3)}


# --- comparisons ---


def compared(here: TestClient, a: str, b: str, **query: str) -> dict:
    answer = here.get(f"{API}/comparisons", params={"a": a, "b": b, **query})
    assert answer.status_code == 200, answer.text
    found: dict = answer.json()
    return found


def test_two_policies_are_compared_on_the_same_episodes(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, ids = site

    found = compared(here, "good", "fair")

    overall, tasks = found["overall"], len(SUITES["hide"])
    assert found["a"] == {"evaluation": ids["good"], "policy": "good", "version": 1}
    assert overall["table"] == {
        "both": 20 * tasks, "only_a": 3 * tasks, "only_b": 0, "neither": 2 * tasks,
    }  # fmt: skip
    assert overall["difference"] == pytest.approx(0.12)
    assert overall["low"] < 0.12 < overall["high"]
    assert overall["p"] < overall["p_exact"] < 1e-9
    assert overall["over_episodes"][0] < 0.12 < overall["over_episodes"][1]
    assert (overall["tasks"], sum(one["tasks"] for one in found["categories"].values())) == (
        tasks,
        tasks,
    )
    assert [one["p"] for one in found["tasks"]] == [pytest.approx(0.125)] * tasks
    assert {one["p_holm"] for one in found["tasks"]} == {1.0}
    assert len(found["discordant"]) == 3 * tasks
    assert {one["better"] for one in found["discordant"]} == {"a"}
    assert found["other_sources"] == [] and found["same_machine"]


def test_a_discordant_episode_leads_to_both(site: tuple[TestClient, dict[str, str]]) -> None:
    here, _ = site

    first = compared(here, "good", "poor")["discordant"][0]

    for side, policy in (("a", "good"), ("b", "poor")):
        episode = here.get(f"{API}/episodes/{first[side]}").json()
        assert (episode["task"], episode["index"]) == (first["task"], first["index"])
        assert episode["policy"] == policy
        assert episode["success"] == (side == first["better"])


def test_the_other_way_round_is_the_same_with_the_sign_turned(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, _ = site

    one, other = compared(here, "good", "poor"), compared(here, "poor", "good")

    assert one["overall"]["difference"] == -other["overall"]["difference"]
    assert one["overall"]["p"] == other["overall"]["p"]
    assert one["overall"]["low"] == pytest.approx(-other["overall"]["high"])


def test_a_part_is_compared_on_what_both_played(site: tuple[TestClient, dict[str, str]]) -> None:
    here, ids = site

    found = compared(here, ids["part"], ids["good"], verdict="exact")

    assert {one["task"] for one in found["tasks"]} == {"search_drawer", "push_button_times"}
    assert found["overall"]["table"] == {"both": 4, "only_a": 2, "only_b": 2, "neither": 2}
    assert found["verdict"] == "exact"


def test_a_policy_compared_with_itself_differs_in_nothing(
    site: tuple[TestClient, dict[str, str]],
) -> None:
    here, _ = site

    overall = compared(here, "good", "good@1")["overall"]

    assert (overall["difference"], overall["p"]) == (0.0, 1.0)
    assert overall["over_episodes"] is None and overall["over_tasks"] is None
    assert overall["low"] < 0 < overall["high"]


def test_what_is_not_comparable_is_refused(site: tuple[TestClient, dict[str, str]]) -> None:
    here, ids = site
    hub = hub_of(here)
    other = {
        "split": ledgers.evaluated(
            hub.database, hub.blobs, "noop", tasks=["search_drawer"], episodes=1, split="val"
        ),
        "rules": ledgers.evaluated(
            hub.database, hub.blobs, "noop", tasks=["search_drawer"], episodes=1, rules="parity"
        ),
        "no episode in common": ledgers.evaluated(
            hub.database, hub.blobs, "noop", tasks=["wipe_desk_rubbish"], episodes=1
        ),
        "queued": create(here, policy="noop")["id"],
    }

    for why, id in other.items():
        params = {"a": ids["part"], "b": id}
        answer = here.get(f"{API}/comparisons", params=params)
        assert answer.status_code == 409, why
        assert problem_of(answer)["code"] == "not_comparable"
        assert why in answer.json()["detail"]
    _cancel(here, other["queued"])


def _cancel(here: TestClient, evaluation: str) -> None:
    with hub_of(here).database.writing() as session:
        lifecycle.cancel(session, session.get_one(Evaluation, evaluation))
        waiting = select(Shard.id).where(Shard.state == "pending")
        assert session.scalars(waiting).all() == []
