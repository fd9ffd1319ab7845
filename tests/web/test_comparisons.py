"""The page that compares policies: what it shows, and what it says of what cannot be compared."""

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from urllib.parse import quote

import pytest
from fastapi import FastAPI

from hide_tasks import SUITES
from hide_tasks.contract import EpisodeSpec, Failure
from tests.server import ledgers
from tests.web import sites
from tests.web.conftest import TestClient

NAMES = ("ada", "bob", "cid", "dot")


def failing(place: int) -> ledgers.Outcomes:
    """Fails every episode whose index ends in a digit up to its place."""

    def outcome(spec: EpisodeSpec) -> Failure | None:
        return Failure.UNDERCOUNT if spec.index % 10 <= place else None

    return outcome


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    app = sites.empty(tmp_path_factory.mktemp("comparisons"))
    hub = app.state.hub
    for place, name in enumerate(NAMES):
        ledgers.registered(hub.database, name)
        ledgers.evaluated(hub.database, hub.blobs, name, failing(place))
    ledgers.registered(hub.database, "late")
    for name, counts in {"eve": (3, 1, 3, 2), "fay": (3,)}.items():
        ledgers.registered(hub.database, name)
        for count in counts:
            on = {"split": "val", "tasks": ["search_drawer"], "episodes": count}
            ledgers.evaluated(hub.database, hub.blobs, name, **on)
    yield app
    hub.stop()


@pytest.fixture
def client(app: FastAPI) -> TestClient:
    return TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)


def page(client: TestClient, query: str, status: int = 200) -> str:
    answer = client.get(f"/comparisons?{query}")
    assert answer.status_code == status, answer.text[:2000]
    return unescape(answer.text)


def cells(text: str) -> list[str]:
    """The addresses behind the numbers of the paired table."""
    table = text.partition('<table class="two-by-two">')[2].partition("</table>")[0]
    return re.findall(r'href="([^"]+)"><b>(\d+)</b>', table)


def test_each_number_of_the_paired_table_leads_to_its_episodes(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=cid")

    found = cells(text)

    assert [int(number) for _, number in found] == [16 * 15, 6 * 15, 0, 3 * 15]
    for address, number in found:
        listed = unescape(client.get(address).text)
        assert f"{number} of 375; each leads" in listed
        assert listed.count(">side by side</a>") == min(int(number), 60)


def test_a_number_of_a_task_leads_to_that_tasks_episodes(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=cid")

    [address] = re.findall(r'href="([^"]+which=only_a&task=search_drawer#episodes)"', text)
    listed = unescape(client.get(address).text)

    assert "6 of 375; each leads" in listed
    assert listed.count("search_drawer</option>") == 1
    assert "<option selected>search_drawer</option>" in listed


def test_old_addresses_of_two_still_work(client: TestClient) -> None:
    old, new = page(client, "a=ada&b=bob"), page(client, "policy=ada&policy=bob")

    assert old == new


def test_a_category_has_its_own_paired_table(client: TestClient) -> None:
    found = cells(page(client, "policy=ada&policy=cid&category=HSR"))

    assert [int(number) for _, number in found] == [16 * 5, 6 * 5, 0, 3 * 5]


def test_several_show_every_pair_and_lead_to_the_two(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=bob&policy=cid")

    matrix = text.partition('class="list matrix"')[2].partition("</table>")[0]
    pairs = re.findall(r'href="/comparisons\?policy=(\w+)&policy=(\w+)"', matrix)
    assert len(pairs) == 6 and ("ada", "cid") in pairs and ("cid", "ada") in pairs
    assert "<b>+12</b>" in matrix and "<b>−12</b>" in matrix


def test_the_grid_has_every_episode_and_a_link_to_two_runs_side_by_side(
    client: TestClient,
) -> None:
    text = page(client, "policy=ada&policy=bob&policy=cid")

    links = re.findall(r'href="/episodes/(ep_\w+)\?beside=(ep_\w+)"', text)
    assert len(links) == 25 * len(SUITES["hide"])
    one, other = (client.get(f"/api/v1/episodes/{id}").json() for id in links[1])
    assert (one["task"], one["index"]) == (other["task"], other["index"])
    assert not one["success"] and other["success"]  # ada managed 1, bob and cid did not


def test_episodes_that_all_or_none_managed_can_be_hidden(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=bob&policy=cid&which=differ")

    grid = text.partition('<table class="grid">')[2].partition("</table>")[0]
    assert grid.count("beside=") == 6 * len(SUITES["hide"])
    assert grid.count("<circle") == 19 * len(SUITES["hide"])


@pytest.mark.parametrize(
    ("which", "count"),
    [("every", 16), ("none", 3), ("only_a", 3), ("lacks_c", 3), ("only_c", 0), ("only_f", 0)],
)
def test_episodes_are_found_by_who_managed_them(client: TestClient, which: str, count: int) -> None:
    text = page(client, f"policy=ada&policy=bob&policy=cid&which={which}")

    assert f"{count * 15} of 375; each leads" in text
    assert ("No episode is like that" in text) == (count == 0)


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [
        ("policy=ada&policy=bbo", 422, "did you mean bob?"),
        ("policy=bbo", 422, "did you mean bob?"),
        ("policy=ada&policy=late", 422, "late@1 has no completed evaluation on hide, test"),
        ("policy=ada&policy=bob&policy=ada@1", 422, "the same as the first"),
        ("policy=ada&policy=bob&split=val", 422, "ada@1 has no completed evaluation on hide, val"),
        ("&".join(f"policy={one}" for one in "abcdefg"), 422, "give 2 to 6 policies"),
    ],
)
def test_what_cannot_be_compared_is_said_beside_what_was_typed(
    client: TestClient, asked: str, status: int, said: str
) -> None:
    text = page(client, asked, status)

    assert said in text and text.count('role="alert"') == 1
    for typed in re.findall(r"policy=([^&]+)", asked):
        assert f'name="policy" value="{typed}"' in text


def test_of_several_evaluations_the_newest_of_the_most_episodes_is_taken_and_told(
    client: TestClient,
) -> None:
    text = page(client, "policy=eve&policy=fay&split=val")
    ones = client.get("/api/v1/evaluations?policy=eve").json()["items"]
    trial, taken, *_ = sorted(ones, key=lambda one: one["id"], reverse=True)

    rates = text.partition('class="list standing"')[2].partition("</table>")[0]
    assert rates.count("1 task × 3 episodes") == 2
    assert f'<a href="/evaluations/{taken["id"]}"><time' in rates
    assert "eve@1 has 3 more completed evaluations on hide, val" in text
    assert "fay@1 has" not in text
    chosen = page(client, f"policy={trial['id']}&policy=fay&split=val")
    assert "1 task × 2 episodes" in chosen and "eve@1 has" not in chosen
    assert 'title="too few episodes"' in text


def test_one_alone_asks_for_another_and_says_who_could_be_it(client: TestClient) -> None:
    text = page(client, "policy=ada")

    assert "One more, and ada is compared" in text
    for name in NAMES[1:]:
        assert f'href="/comparisons?policy=ada&policy={name}%401"' in text
    assert 'aria-label="Add ada' not in text


def test_the_verb_leads_to_the_page(client: TestClient) -> None:
    answer = client.get("/compare?policy=ada&policy=bob", follow_redirects=False)

    assert answer.status_code == 308
    assert answer.headers["location"] == "/comparisons?policy=ada&policy=bob"


def test_a_policy_is_taken_out_by_a_link(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=bob&policy=cid")

    assert re.search(r'href="/comparisons\?policy=ada&policy=cid" aria-label="Remove bob"', text)


def test_nothing_that_was_typed_becomes_markup(client: TestClient) -> None:
    typed = quote('"><script>alert(1)</script>')

    answer = client.get(f"/comparisons?policy=ada&policy={typed}")

    assert answer.status_code == 422 and "<script>alert" not in answer.text


@pytest.mark.parametrize(
    "query", ["which=some", "which=only_g", "category=XX", "split=best", "suite=full"]
)
def test_a_wrong_question_is_refused_with_a_page(client: TestClient, query: str) -> None:
    answer = client.get(f"/comparisons?policy=ada&policy=bob&{query}")

    assert answer.status_code == 422
    assert answer.headers["content-type"].startswith("text/html")


def test_a_server_without_evaluations_says_what_to_do(tmp_path: Path) -> None:
    app = sites.empty(tmp_path / "new")

    text = TestClient(app, base_url="http://127.0.0.1").get("/comparisons").text

    assert "Nothing is completed on hide, test yet" in text and 'href="/evaluations/new"' in text
    app.state.hub.stop()


# --- other suites ---


def addresses(text: str) -> list[str]:
    """Where a page leads to a comparison, or to the file of one."""
    return re.findall(r'(?:href|src)="((?:/api/v1)?/comparisons[^"]*)"', text)


def files_of(found: list[str]) -> set[str]:
    """The formats of the files among some addresses."""
    return {one.rpartition("format=")[2] for one in found if "/export" in one}


def test_a_comparison_on_another_suite_keeps_it_in_all_its_addresses(
    every_suite: TestClient,
) -> None:
    text = page(every_suite, "policy=mine&policy=expert&suite=hide-hard&which=differ")

    assert "Suite hide-hard 1, split test" in text
    assert "<option selected>hide-hard</option>" in text
    assert '<input type="hidden" name="suite" value="hide-hard">' in text
    found = [one for one in addresses(text) if "policy=" in one]
    assert len(found) > 20 and all("suite=hide-hard" in one for one in found)
    assert files_of(found) == {"csv", "json"}
    for address in found[:30]:
        assert every_suite.get(address).status_code == 200, address


def test_the_usual_suite_is_not_said_in_addresses(every_suite: TestClient) -> None:
    found = addresses(page(every_suite, "policy=mine&policy=expert"))

    assert all("suite=" not in one for one in found if "/export" not in one)
    assert files_of(found) == {"csv", "json", "latex"}


def test_evaluations_named_by_ids_lead_to_their_suite(every_suite: TestClient) -> None:
    rows = every_suite.get("/api/v1/leaderboard?suite=real4").json()["rows"]

    text = page(every_suite, "&".join(f"policy={row['evaluation']}" for row in rows))

    assert "Suite real4 1, split test" in text and "<option selected>real4</option>" in text
    found = [one for one in addresses(text) if "policy=" in one]
    assert found and all("suite=real4" in one for one in found)


def test_what_is_suggested_is_of_the_suite(client: TestClient, every_suite: TestClient) -> None:
    text = page(every_suite, "policy=mine&suite=real4")
    nothing = page(client, "suite=real4")

    [address] = re.findall(r'href="([^"]+)" aria-label="Add expert@1, 100.% of 100 episodes"', text)
    assert address == "/comparisons?policy=mine&policy=expert%401&suite=real4"
    assert "Completed on real4, test" in text
    assert "Nothing is completed on real4, test yet" in nothing


def test_who_has_nothing_on_a_suite_is_told_beside_the_name(client: TestClient) -> None:
    text = page(client, "policy=ada&policy=bob&suite=hide-hard", 422)

    assert (
        "ada@1 has no completed evaluation on hide-hard, test; there is one on hide, test" in text
    )
    assert "<option selected>hide-hard</option>" in text
