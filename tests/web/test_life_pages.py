"""Pages of submission, evaluation, tasks, first run and errors, as they come from the server."""

import re
from html import unescape
from pathlib import Path

import pytest

from hide_tasks import SUITES
from server import lifecycle
from server.states import EpisodeState
from tests.server import ledgers
from tests.server.people import peopled, token_of, visitor
from tests.web import sites
from tests.web.conftest import TestClient
from tests.web.sites import Site
from web.aliases import clearest, explaining
from web.wording import ABOUT_SUITES, ordinal


def page(client: TestClient, path: str, status: int = 200) -> str:
    answer = client.get(path)
    assert answer.status_code == status, answer.text
    return unescape(answer.text)


def test_an_evaluation_is_grouped_by_category(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}")

    assert re.findall(r'class="kind-rows" data-kind="(\w+)"', text) == ["RC", "HSR", "EPT"]


def test_a_running_episode_is_one_click_from_being_watched(client: TestClient, site: Site) -> None:
    [running] = site.episodes(site.running, state=EpisodeState.RUNNING)

    text = page(client, f"/evaluations/{site.running}")

    assert f'href="/episodes/{running}">Watch' in text
    assert '<rect class="running"' in text and '<rect class="failed"' in text


def test_what_is_handed_out_says_so_once_nothing_waits(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)
    client = TestClient(app, base_url="http://127.0.0.1")
    with app.state.hub.database.writing() as session:
        id = ledgers.created(session, "expert", tasks=["search_drawer"], episodes=10).id
    queued = page(client, f"/evaluations/{id}")
    with app.state.hub.database.writing() as session:
        attempt, shard = sites.taken(session)
        lifecycle.begin(session, attempt, lifecycle.open_episodes(shard)[0])
        sites.taken(session)

    running = page(client, f"/evaluations/{id}")

    app.state.hub.stop()
    assert "1st in the queue" in queued and "waits for a worker" not in queued
    assert "Nothing waits to be handed out. 1 shard is with a worker, which plays" in running
    assert "1 shard is ready for the next worker that is free." in running


def test_what_was_cancelled_before_it_was_played_is_not_pending(
    client: TestClient, site: Site
) -> None:
    text = page(client, f"/evaluations/{site.cancelled}")

    assert 'title="Episode 1: not played"' in text
    assert "</i>not played</span>" in text and ": pending" not in text
    assert "</i>pending</span>" in page(client, f"/evaluations/{site.running}")


def test_what_changes_is_given_out_alone(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.running}/live")

    assert text.count('id="live-now"') == text.count('id="live-rest"') == 1
    assert "<html" not in text
    page(client, "/evaluations/none/live", 404)


def test_an_ended_evaluation_says_whether_it_is_published(client: TestClient, site: Site) -> None:
    incomplete, kept, running = (
        page(client, f"/evaluations/{id}") for id in (site.incomplete, site.completed, site.running)
    )

    assert "Not published: It is incomplete" in incomplete
    assert 'Published: <a href="/snapshots/1">snapshot 1</a>' in kept
    assert "ublished" not in running


def test_a_rerun_fills_the_form_in(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/new?like={site.incomplete}")

    assert "As <a" in text and "broken@1" in text
    assert re.search(r'value="broken@1" selected', text)
    assert re.findall(r'name="tasks" value="(\w+)" checked', text) == ["search_drawer"]
    assert 'id="episodes" name="episodes" type="number" min="1" placeholder="all" value="5"' in text
    page(client, "/evaluations/new?like=none", 404)


@pytest.mark.parametrize(("asked", "chosen"), [("", ""), ("suite=real4", "real4")])
def test_the_form_begins_with_the_suite_that_a_page_was_of(
    client: TestClient, asked: str, chosen: str
) -> None:
    text = page(client, f"/evaluations/new?{asked}")

    assert re.findall(r'name="category" value="([\w-]*)"[^>]* checked', text) == [chosen]
    page(client, "/evaluations/new?suite=rlbench", 422)


@pytest.mark.parametrize("suite", ["hide-hard", "real4"])
def test_an_empty_board_speaks_of_its_own_suite(tmp_path: Path, suite: str) -> None:
    app = sites.empty(tmp_path)
    client = TestClient(app, base_url="http://127.0.0.1")

    board = page(client, f"/?suite={suite}")
    task = page(client, f"/tasks/{SUITES[suite][0]}")

    app.state.hub.stop()
    assert ABOUT_SUITES[suite] in board
    for text in (board, task):
        assert f'href="/evaluations/new?suite={suite}"' in text


def test_a_task_shows_a_chosen_alias_pair_large(client: TestClient) -> None:
    plain, third = page(client, "/tasks/search_drawer"), page(client, "/tasks/search_drawer?pair=3")

    assert "Not one pixel differs" in plain
    hero = third.partition("hero-pair")[2].partition("</figure>")[0]
    assert "search_drawer-alias-3-a.webp" in hero and "open bottom" in hero
    assert 'pair=3" aria-current="true"' in third
    assert "has 3 alias pairs" in page(client, "/tasks/search_drawer?pair=4", 422)
    page(client, "/tasks/search_drawer?pair=one", 422)


def test_a_pair_that_a_picture_may_tell_apart_does_not_claim_memory(client: TestClient) -> None:
    claim = "Only what was remembered tells them apart"

    assert claim in page(client, "/tasks/stack_blocks_hard")
    assert claim not in page(client, "/tasks/real_stack_cups")  # a probe reads it in 84 %


def test_a_task_without_an_alias_pair_says_so(client: TestClient) -> None:
    assert "No alias pair" in page(client, "/tasks/stack_blocks")


def test_the_best_policies_stand_beside_a_task(client: TestClient, site: Site) -> None:
    best = page(client, "/tasks/search_drawer").partition("Best policies on it")[2]

    assert f"/evaluations/{site.completed}/failures?task=search_drawer&verdict=all" in best
    assert best.index(">expert<") < best.index(">mine<")


def test_the_pair_that_explains_differs_in_no_pixel() -> None:
    found = explaining()

    assert found and found[0] == "push_button_times"
    assert max(found[1].pixels.values()) == 0 and len(found[1].pictures) == 2
    assert clearest([]) is None


def test_an_empty_server_explains_itself(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)

    text = page(TestClient(app, base_url="http://127.0.0.1"), "/")

    app.state.hub.stop()
    assert "Not one pixel differs" in text
    for way in ('action="/demo"', "?source=upload", "?source=server", 'href="/evaluations/new"'):
        assert way in text


def test_the_demo_is_begun_once(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)
    client = TestClient(app, base_url="http://127.0.0.1", follow_redirects=False)

    before = page(client, "/demo")
    answers = [client.post("/demo") for _ in range(2)]
    found = client.get("/api/v1/evaluations").json()["items"]
    client.post(f"/api/v1/evaluations/{found[0]['id']}/cancellation")
    again = page(client, "/demo")
    client.post("/demo")
    more = client.get("/api/v1/evaluations").json()["items"]

    app.state.hub.stop()
    assert "Run the demo" in before and "Run the demo" in again
    assert [(one.status_code, one.headers["location"]) for one in answers] == [(303, "/demo")] * 2
    assert [(one["policy"], one["progress"]["expected"]) for one in found] == [
        ("amnesiac", 6),
        ("expert", 6),
    ]
    assert len(more) == 3 and more[0]["policy"] == "amnesiac"


# --- errors ---


@pytest.mark.parametrize(
    ("path", "nearest"),
    [
        ("/evaluation", "/evaluations"),
        ("/snapshot", "/snapshots"),
        ("/tasks/serch_drawer", "/tasks/search_drawer"),
        ("/episodes/none", "/evaluations"),
    ],
)
def test_what_is_not_there_is_near_to_something(
    client: TestClient, path: str, nearest: str
) -> None:
    advice = page(client, path, 404).partition('class="advice"')[2]

    assert f'href="{nearest}"' in advice


def test_a_wrong_address_leads_to_the_same_page_without_it(client: TestClient) -> None:
    text = page(client, "/evaluations?state=asleep", 422)

    assert 'class="button" href="/evaluations"' in text


def test_whoever_may_not_is_told_who_may(tmp_path: Path) -> None:
    with peopled(tmp_path) as app:
        asking = visitor(app, token_of(app, "viewer"))

        answer = asking.get("/evaluations/new")

    assert answer.status_code == 403
    assert "a viewer" in answer.text and "administrator" in answer.text


def test_places_are_said_as_people_do() -> None:
    said = [ordinal(place) for place in (1, 2, 3, 4, 11, 12, 13, 21, 102, 111)]

    assert said == ["1st", "2nd", "3rd", "4th", "11th", "12th", "13th", "21st", "102nd", "111th"]
