"""The page of failures: facets narrow, cards lead to replays, and every emptiness has a way out."""

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import pytest
from sqlalchemy import func, select

from hide_tasks.contract import Failure
from server import labels
from server.models import Episode
from server.schemas.episodes import LabelCreate
from tests.web import sites
from tests.web.conftest import TestClient
from tests.web.sites import Site
from web.wording import FAILURES


def page(client: TestClient, path: str, status: int = 200) -> str:
    answer = client.get(path)
    assert answer.status_code == status, path
    return answer.text


def links(text: str) -> list[str]:
    return [unescape(link) for link in re.findall(r'href="([^"]*)"', text)]


def shown(text: str) -> list[str]:
    """Ids of the cards, in order."""
    return re.findall(r'class="card" data-episode="([^"]+)"', text)


def counts(text: str) -> dict[str, tuple[str, int]]:
    """Address and count of each value of each facet, by its name."""
    one = r'<a href="([^"]+)"[^>]*><span class="name">(.*?)</span> <span class="count">([\d,]+)<'
    found = re.findall(one, text)
    return {
        re.sub("<wbr>", "", name): (unescape(link).partition("#")[0], int(count.replace(",", "")))
        for link, name, count in found
    }


def total(text: str) -> int:
    return int(re.search(r"<b>([\d,]+)</b> episodes?", text)[1].replace(",", ""))


def test_failures_of_all_evaluations_are_shown(client: TestClient, site: Site) -> None:
    text = page(client, "/failures")
    with site.hub.database.reading() as session:
        whole = session.scalar(select(func.count()).where(Episode.failure.is_not(None)))

    assert total(text) == whole
    assert f"<b>{whole}</b> episodes that are not exact, in all evaluations" in text
    assert len(shown(text)) == 30
    assert 'aria-current="page">Failures' in text


def test_a_facet_leads_to_as_many_episodes_as_it_says(client: TestClient, site: Site) -> None:
    found = counts(page(client, f"/evaluations/{site.completed}/failures?task=search_drawer"))

    assert {"search_drawer", "mine@1", "failed", "item in top", "press 3"} <= set(found)
    del found["search_drawer"]  # it is chosen: its link goes back
    for name, (link, count) in found.items():
        if "task=search_drawer&task=" not in link:  # that finds both tasks
            assert total(page(client, link)) == count, name


def test_two_values_of_a_facet_show_both(client: TestClient, site: Site) -> None:
    one = page(client, f"/evaluations/{site.completed}/failures?failure=overcount")
    both = page(client, counts(one)["undercount"][0])

    expected = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    expected += site.episodes(site.completed, failure=Failure.UNDERCOUNT)
    assert total(both) == len(expected)
    assert counts(both)["overcount"][1] == counts(one)["overcount"][1]


def test_a_policys_bare_name_is_all_its_versions(client: TestClient) -> None:
    bare, versioned = (page(client, f"/failures?policy={one}") for one in ("mine", "mine%401"))

    assert total(bare) == total(versioned) == counts(bare)["mine@1"][1]
    assert "mine" not in counts(bare)
    [ticked] = re.findall(r'<a href="([^"]+)" aria-current="true"><span class="name">mine@1<', bare)
    assert "policy=mine" not in ticked


def test_a_card_says_what_went_wrong(client: TestClient, site: Site) -> None:
    path = f"/evaluations/{site.completed}/failures?task=push_button_times"
    text = unescape(page(client, path))

    [id, *_] = shown(text)
    [card] = re.findall(rf'data-episode="{id}".*?</dl>', text, re.DOTALL)
    assert "mine@1" in card and "“do push_button_times”" in card and "press 3" in card
    assert re.search(
        rf'href="/evaluations/{site.completed}" title="Its evaluation">test · <time ', card
    )
    assert "3 of 25" in card and "expert" in card
    assert any(meaning in card for meaning in FAILURES.values())


def test_a_card_leads_to_an_episode_whose_neighbours_are_the_next_cards(
    client: TestClient,
) -> None:
    text = page(client, "/failures?task=search_drawer&sort=task")
    first, second, third, *_ = shown(text)
    [link] = {one for one in links(text) if one.startswith(f"/episodes/{second}?")}

    neighbours = [one for one in links(page(client, link)) if one.startswith("/episodes/")]

    assert [one.partition("?")[0] for one in neighbours[:2]] == [
        f"/episodes/{first}",
        f"/episodes/{third}",
    ]
    assert all("sort=task" in one and "verdict=inexact" in one for one in neighbours[:2])
    assert "/failures?task=search_drawer&verdict=inexact&sort=task#episodes" in links(
        page(client, link)
    )


def test_an_episode_keeps_several_values_of_a_filter(client: TestClient, site: Site) -> None:
    [id, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    query = "?failure=overcount&failure=undercount&labelled=false"
    text = page(client, f"/episodes/{id}{query}")

    assert text.count('type="hidden" name="failure"') == 2
    assert "/failures?failure=overcount&failure=undercount&labelled=False#episodes" in links(text)
    assert "Labels and notes" in text


def test_hidden_values_and_variations_narrow_within_a_task(client: TestClient, site: Site) -> None:
    narrowed = f"/evaluations/{site.completed}/failures?task=push_button_times"
    found = counts(page(client, narrowed))

    assert "presses done 3" in found and "count 2" in found
    link, count = found["count 2"]
    assert "variation=count%3D2" in link and total(page(client, link)) == count
    assert "Choose one task" not in page(client, narrowed)
    assert "Choose one task" in page(client, "/failures")


@pytest.mark.parametrize(
    ("query", "right"),
    [
        ("task=serch_drawer", "search_drawer"),
        ("failure=bad_luck", "undercount"),
        ("variation=colour%3Dred", "there are"),
        ("variation=red", "name=value"),
        ("hidden=3", "name=value"),
        ("text=" + "x" * 201, "at most 200"),
        ("sort=best", "newest"),
        ("cursor=nonsense", "leave it out"),
        ("verdict=worst", "inexact"),
    ],
)
def test_what_is_wrong_is_told_with_what_is_right(
    client: TestClient, site: Site, query: str, right: str
) -> None:
    assert right in unescape(page(client, f"/failures?{query}", 422))
    assert right in unescape(page(client, f"/evaluations/{site.completed}/failures?{query}", 422))


def test_what_is_wrong_is_told_in_our_words_alone(client: TestClient) -> None:
    assert "Value error" not in page(client, "/failures?variation=red", 422)


def test_an_unknown_evaluation_is_not_found(client: TestClient) -> None:
    page(client, "/failures?evaluation=ev_x", 404)
    page(client, "/evaluations/ev_x/failures", 404)


def test_text_is_looked_for_in_instructions_and_details(client: TestClient) -> None:
    found = page(client, "/failures?text=alert")
    assert total(found) == total(page(client, "/failures?failure=policy_error&text=script"))
    assert sites.NASTY not in found and "&lt;script&gt;" in found


def test_nothing_that_matches_says_which_filter_to_drop(client: TestClient) -> None:
    text = page(client, "/failures?text=zebra&task=search_drawer")

    assert "No episode matches" in text and "Drop text “zebra”" in unescape(text)
    [link] = [one for one in links(text) if one == "/failures?task=search_drawer#episodes"][:1]
    assert total(page(client, link.partition("#")[0])) > 0
    assert "Drop task" not in unescape(text)  # it would not help


def test_filters_that_only_together_let_something_through_are_all_dropped(
    client: TestClient,
) -> None:
    text = page(client, "/failures?text=zebra&label=never")

    assert "More than one filter" in text and "/failures" in links(text)


def test_an_empty_server_says_what_to_do(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)
    client = TestClient(app, base_url="http://127.0.0.1")

    assert "Nothing has been evaluated yet" in page(client, "/failures")
    assert "/evaluations/new" in links(page(client, "/failures"))
    app.state.hub.stop()


def test_an_evaluation_without_failures_says_so(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.recorded}/failures")
    waits = page(client, f"/evaluations/{site.queued}/failures")

    assert "Every final episode is exact" in text and "Nothing failed in 1 episode" in text
    assert f"/evaluations/{site.recorded}/failures?verdict=all#episodes" in links(text)
    assert "No episode is final yet" in waits


def test_what_is_shown_can_be_taken_along(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}/failures?failure=overcount")
    [csv] = [link for link in links(text) if "format=csv" in link]
    [lines] = [link for link in links(text) if "format=jsonl" in link]
    [rest] = [link for link in links(text) if link.startswith("/api/v1/episodes?")]
    [facets] = [link for link in links(text) if link.startswith("/api/v1/episodes/facets?")]

    count = total(text)
    assert len(page(client, csv).splitlines()) == count + 1
    assert len(page(client, lines).splitlines()) == count
    assert len(client.get(rest).json()["items"]) == count
    assert client.get(facets).json()["episodes"] == count


@pytest.fixture
def labelled(site: Site) -> Iterator[str]:
    """An episode with a label and a nasty note, which are taken back afterwards."""
    [id, *_] = site.episodes(site.completed, failure=Failure.WRONG_RECALL)
    with site.hub.database.writing() as session:
        episode = session.get_one(Episode, id)
        said = labels.add(
            session, episode, LabelCreate(label="blind", note=sites.NASTY), site.hub.owner
        )
    yield id
    with site.hub.database.writing() as session:
        labels.withdraw(session, said.id, site.hub.owner)


def test_labels_and_notes_are_on_the_card_and_narrow(client: TestClient, labelled: str) -> None:
    text = page(client, "/failures?label=blind")

    assert shown(text) == [labelled] and counts(text)["blind"][1] == 1
    assert sites.NASTY not in text and f"<q>{sites.NASTY}</q>" in unescape(text)
    assert labelled not in shown(page(client, "/failures?labelled=false&failure=wrong_recall"))
