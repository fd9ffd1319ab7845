"""An episode's page: belief against truth, memory, another run, commands, what is missing."""

import re
from collections.abc import Iterator
from html import unescape

import pytest
from fastapi.testclient import TestClient

from hide_tasks.contract import Failure
from server.schemas.episodes import BeliefCheck, BeliefsPublic, PartingPublic
from server.states import EpisodeState
from tests.web import sites
from tests.web.sites import Site
from web import belief_track
from web.beside import pairs
from web.memory_panel import memories
from web.routes_episodes import View


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Site, str]]:
    """A site where two policies played an episode; the amnesiac's run of it."""
    site = sites.filled(
        sites.empty(tmp_path_factory.mktemp("two")), tmp_path_factory.mktemp("recordings")
    )
    amnesiac = sites.recorded_run(site.hub, tmp_path_factory.mktemp("others"), "amnesiac")
    [id] = site.episodes(amnesiac)
    yield site, id
    site.hub.stop()


def page(site: Site, path: str, status: int = 200) -> str:
    asking = TestClient(site.app, base_url="http://127.0.0.1", raise_server_exceptions=False)
    answer = asking.get(path)
    assert answer.status_code == status, answer.text
    return unescape(answer.text)


def expert_of(site: Site) -> str:
    [id] = site.episodes(site.recorded)
    return id


# --- belief against truth ---


def checks(*found: tuple[int, int, list[int]]) -> BeliefsPublic:
    """Of (decision, believed, true)."""
    said = [
        BeliefCheck(decision=at, believed=n, true=true, right=n in true if true else None)
        for at, n, true in found
    ]
    known = [one for one in said if one.right is not None]
    right = sum(bool(one.right) for one in known)
    return BeliefsPublic(stated=len(said), checked=len(known), right=right, decisions=said)


def test_the_belief_lies_under_the_truth_and_is_marked_where_it_differs() -> None:
    beliefs = checks((0, 0, [0, 1]), (1, 0, [0, 1]), (2, 0, [1]), (3, 2, []))

    truth, count = belief_track.lanes(beliefs, [0.0, 1.0, 2.0, 3.0, 4.0])

    assert [(one.value, one.begin, one.end) for one in truth.spans] == [
        ("0–1", 0.0, 2.0),
        ("1", 2.0, 3.0),
        ("–", 3.0, 4.0),
    ]
    assert [(one.value, one.state) for one in count.spans] == [
        ("0", "right"),
        ("≠ 0", "wrong"),
        ("2", "unknown"),
    ]
    assert belief_track.summary(beliefs) == (
        "Belief right at 2 of 3 decisions; off the experts' ways at 1 more."
    )


def test_decisions_without_a_count_leave_a_gap() -> None:
    _, count = belief_track.lanes(checks((0, 1, [1]), (2, 1, [1])), [0.0, 1.0, 2.0, 3.0])

    assert [(one.begin, one.end) for one in count.spans] == [(0.0, 1.0), (2.0, 3.0)]


def test_a_policy_that_counts_nothing_has_no_track() -> None:
    assert list(belief_track.lanes(checks(), [0.0])) == []


def test_the_page_sums_it_up_and_hatches_it(two: tuple[Site, str]) -> None:
    site, _ = two
    text = page(site, f"/episodes/{expert_of(site)}")

    assert "Belief right at 5 of 8 decisions." in text
    assert text.count('fill="url(#hatch)"') == 1 + text.count("span count wrong")
    assert text.count("span count wrong") >= 1


# --- memory ---


def test_memory_is_what_was_stated_at_the_decision(two: tuple[Site, str]) -> None:
    site, _ = two
    id = expert_of(site)
    text = page(site, f"/episodes/{id}?at=6")
    [shown] = re.findall(r'data-memory="6">(.*?)<div class="stated"', text, re.DOTALL)

    pictures = re.findall(rf"/episodes/{id}/observations/(\d)/front.jpg", shown)
    assert pictures == ["0", "2", "3", "4", "5"]  # the anchor first
    assert "≠ true 3–5" in shown
    assert "0.83" in shown and "93" in shown


def test_the_latest_entry_of_the_window_is_its_first_slot() -> None:
    from tests.web.sites import believed

    class One:
        decision, belief = 6, believed(6)

    [memory] = memories([One()], checks())  # type: ignore[list-item]

    assert [(one.decision, one.slot) for one in memory.window] == [
        (2, "window 4"),
        (3, "window 3"),
        (4, "window 2"),
        (5, "window 1"),
    ]
    assert memory.anchor and memory.anchor.decision == 0
    assert memory.anchor.weight == pytest.approx(2 / 7, abs=1e-3)


def test_a_policy_without_belief_is_told_what_it_may_state(two: tuple[Site, str]) -> None:
    site, _ = two
    [id, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)

    assert "docs/remote_policies.md" in page(site, f"/episodes/{id}")


# --- another run ---


def test_where_it_parts_from_the_expert_is_said_and_offered(two: tuple[Site, str]) -> None:
    site, amnesiac = two
    text = page(site, f"/episodes/{amnesiac}")

    assert "It parts from the expert at" in text
    assert f'value="{expert_of(site)}" selected' in text
    assert f"beside={expert_of(site)}" in text
    assert 'class="parted"' in text


def test_the_runs_stand_beside_each_other_decision_by_decision(two: tuple[Site, str]) -> None:
    site, amnesiac = two
    text = page(site, f"/episodes/{amnesiac}?beside={expert_of(site)}&at=7")

    assert text.count("Here they part.") == 1
    assert text.count('class="parted"') == 2  # in both timelines
    assert text.count('id="other-timeline"') == 1
    assert len(re.findall(r'data-scale="([\d.]+)"', text)) == 2
    assert len(set(re.findall(r'data-scale="([\d.]+)"', text))) == 1
    for id in (amnesiac, expert_of(site)):
        assert f"/episodes/{id}/observations/7/wrist.jpg" in text


@pytest.mark.parametrize(("other", "status"), [("none", 404), ("another", 409), ("itself", 422)])
def test_what_cannot_stand_beside_it_is_told(
    two: tuple[Site, str], other: str, status: int
) -> None:
    site, amnesiac = two
    [another, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    named = {"another": another, "itself": amnesiac}.get(other, other)

    page(site, f"/episodes/{amnesiac}?beside={named}", status)


def test_runs_that_part_at_different_numbers_are_aligned_there() -> None:
    parting = PartingPublic(decision=1, other_decision=2, why="")

    found = pairs(["a0", "a1"], ["b0", "b1", "b2"], parting)  # type: ignore[list-item]

    assert [(one.one, one.other, one.parts) for one in found] == [
        (None, "b0", False),
        ("a0", "b1", False),
        ("a1", "b2", True),
    ]


# --- the address, and what is missing ---


def test_a_moment_goes_along_to_no_neighbour() -> None:
    view = View(at="3", beside="ep_1", failure="overcount")

    assert {k for k, v in view.fields().items() if v} == {"failure"}


@pytest.mark.parametrize("at", ["-1", "x", "1e9"])
def test_a_moment_that_is_none_is_told(two: tuple[Site, str], at: str) -> None:
    site, amnesiac = two

    page(site, f"/episodes/{amnesiac}?at={at}", 422)


def test_a_moment_past_the_end_is_the_end(two: tuple[Site, str]) -> None:
    site, amnesiac = two

    assert "Seen at the end" in page(site, f"/episodes/{amnesiac}?at=99")


def test_the_moment_goes_along_when_a_run_is_set_beside_or_taken_away(
    two: tuple[Site, str],
) -> None:
    site, amnesiac = two
    alone = page(site, f"/episodes/{amnesiac}?at=2")
    both = page(site, f"/episodes/{amnesiac}?at=2&beside={expert_of(site)}")

    assert 'id="compare-at" value="2">' in alone and 'id="compare-at" value="2">' in both
    assert f'id="compare" href="/episodes/{amnesiac}?at=2"' in both
    assert 'value="0" disabled>' in page(site, f"/episodes/{amnesiac}")


def test_without_a_recording_there_are_no_pictures_and_all_the_rest(two: tuple[Site, str]) -> None:
    site, _ = two
    [id, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    text = page(site, f"/episodes/{id}")

    assert "/observations/" not in text
    assert 'id="timeline"' in text and 'id="step-on"' in text
    assert "hide eval python:" in text
    assert f"/api/v1/episodes/{id}/actions.json" in text


def test_people_may_label_it_here(two: tuple[Site, str]) -> None:
    site, amnesiac = two

    assert f'data-labels="{amnesiac}"' in page(site, f"/episodes/{amnesiac}")


def test_an_episode_that_waits_offers_nothing_to_play_again(two: tuple[Site, str]) -> None:
    site, _ = two
    [id, *_] = site.episodes(site.running, state=EpisodeState.PENDING)

    assert "hide eval" not in page(site, f"/episodes/{id}")
