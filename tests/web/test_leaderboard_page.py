"""The leaderboard's page: every state of it has an address, and says the same as the REST API."""

import re
from collections.abc import Mapping
from html import unescape
from typing import Any
from xml.etree import ElementTree

import pytest
from fastapi.testclient import TestClient
from markupsafe import Markup

from hide_tasks import SUITES
from server import leaderboard
from server.published import METHODS
from server.schemas.leaderboard import Leaderboard
from tests.server.clients import API
from tests.web.sites import Site
from tests.web.test_pages import links, page
from web import board, board_charts
from web.board import PageQuery, Shown, fields

STATES = [
    "/?view=bars",
    "/?view=radar&verdict=exact",
    "/?view=tasks&category=HSR",
    "/?view=tasks&policy=mine@1&policy=expert@1",
    "/?sort=search_drawer&order=asc",
    "/?category=RC&privileged=hide&clock=unknown&published=no",
    "/?search=&category=&memory=&clock=&owner=&since=",
    "/?search=nobody",
    "/?search=nobody&view=bars",
    "/?since=2020-01-01&sort=belief&rows=all",
    "/snapshots/1?view=bars",
    "/snapshots/1?sort=policy&category=EPT",
]


def rows_of(text: str) -> list[str]:
    """The policies of the table's lines, from the top."""
    return re.findall(r'<th scope="row"><div class="who"><input [^>]*value="([^"@]+)@', text)


def charts_of(text: str) -> list[ElementTree.Element]:
    """The charts of a page."""
    return [
        ElementTree.fromstring(one)
        for one in re.findall(r"<svg (?:(?!<svg).)*?</svg>", text, re.DOTALL)
        if 'role="img"' in one
    ]


@pytest.mark.parametrize("path", STATES)
def test_every_state_is_whole_and_all_its_addresses_lead_to_it(
    client: TestClient, path: str
) -> None:
    text = page(client, path)

    assert text.rstrip().endswith("</html>") and len(re.findall("<h1", text)) == 1
    here = [link for link in links(text) if link.startswith("/?")]
    assert {client.get(link).status_code for link in here[:12]} <= {200}


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("sort=beauty", "sorted by one of"),
        ("view=pie", "'radar'"),
        ("since=soon", "date"),
        ("policy=nobody@1&view=bars", "does not stand on this leaderboard"),
        ("&".join(f"policy=p{n}@1" for n in range(9)), "at most 8"),
        ("suite=rlbench", "the suites are hide, hide-hard, real4"),
        ("category=XX", "RC"),
    ],
)
def test_what_makes_no_sense_is_said(client: TestClient, query: str, said: str) -> None:
    assert said in unescape(page(client, f"/?{query}", 422))


def test_every_column_is_headed_by_a_link_that_sorts(client: TestClient) -> None:
    text = page(client, "/?sort=gap")

    addresses = links(text)
    for column in (
        "rank",
        "policy",
        "ended",
        "overall",
        "normalised",
        "belief",
        "RC",
        *SUITES["hide"],
    ):
        wanted = "/" if column == "rank" else f"/?sort={column}"
        assert wanted in addresses, column
    assert "/?sort=gap&order=asc" in addresses
    assert re.findall('aria-sort="([a-z]+)"', text) == ["descending"]
    assert re.findall('aria-sort="([a-z]+)"', page(client, "/")) == ["ascending"]  # of ranks


def test_the_page_has_the_rows_of_the_api_in_its_order(client: TestClient) -> None:
    for query in ("sort=policy&order=desc", "privileged=hide", "search=e", "memory=script"):
        found = client.get(f"{API}/leaderboard?{query}").json()

        assert rows_of(page(client, f"/?{query}")) == [row["policy"] for row in found["rows"]]


def test_a_filter_says_that_ranks_are_those_among_all(client: TestClient) -> None:
    text = page(client, "/?privileged=hide")

    assert "1 of 2 policies" in text and "Ranks and rank sets are those among all" in text
    assert "are those among all" not in page(client, "/")


def test_a_rank_tells_what_chance_leaves(client: TestClient) -> None:
    text = page(client, "/")

    assert re.search(r'class="rank" title="Rank 1 by success. [^"]+">1</span>', text)


def test_the_papers_rows_stand_apart_and_are_switched_off(client: TestClient) -> None:
    text = page(client, "/?sort=policy")
    block = text[text.index('class="published"') :]

    places = [block.index(f">{name}<small>paper") for name in METHODS]
    assert places == sorted(places)  # the paper's order, whatever is sorted by
    assert "another simulator" in block and "never ranked" in block
    assert 'name="published"' in text and "The paper's figures were measured" in text
    assert 'class="published"' not in page(client, "/?published=no")
    assert 'class="published"' not in page(client, "/?view=bars")


@pytest.mark.parametrize("suite", ["hide-hard", "real4"])
def test_nothing_of_the_paper_stands_beside_another_suite(
    every_suite: TestClient, suite: str
) -> None:
    text = page(every_suite, f"/?suite={suite}&published=yes")

    assert rows_of(text) == ["mine", "expert"]
    assert "rinted in the paper" not in text and 'name="published"' not in text
    assert "The paper's figures" not in text
    assert not any(f">{name}<small>paper" in text for name in METHODS)


@pytest.mark.parametrize("view", ["bars", "radar", "tasks"])
def test_a_chart_says_in_words_what_it_draws(client: TestClient, view: str) -> None:
    text = page(client, f"/?view={view}&policy=mine@1&policy=expert@1")
    found = client.get(f"{API}/leaderboard").json()["rows"]
    charts = charts_of(text)

    assert len(charts) == {"bars": 4, "radar": 1, "tasks": 3}[view]
    for chart in charts:
        title, told = chart[0], chart[1]
        assert chart.get("aria-labelledby") == title.get("id") and title.text
        assert chart.get("aria-describedby") == told.get("id")
        assert "mine@1" in (told.text or "") and "expert@1" in (told.text or "")
    said = " ".join(chart[1].text or "" for chart in charts)
    for row in found:
        rates = row["tasks"] if view == "tasks" else row["categories"]
        for rate in rates.values():
            assert f"{100 * rate['success']['value']:.0f} %" in said
    assert "The figures as a table" in text


def test_the_ends_of_a_radars_axes_hold_all_that_is_shown(client: TestClient) -> None:
    whole = Leaderboard.model_validate(client.get(f"{API}/leaderboard").json())
    low = whole.model_copy(update={"ceilings": dict.fromkeys(whole.ceilings, 0.131)})
    charted = board_charts.numbered(row for row in whole.rows if row.policy == "mine")

    ends = board_charts.scales(low, charted)

    rates = {kind: one.success.value for kind, one in charted[0].row.categories.items()}
    assert all(0 <= end - max(rates[kind] or 0, 0.131) < 0.1 for kind, end in ends.items())


def test_without_a_choice_charts_have_the_first_rows_and_the_expert(client: TestClient) -> None:
    key = re.findall(r'class="chart-key".*?</ol>', page(client, "/?view=bars"), re.DOTALL)[0]

    assert re.findall(r"<b>(\d)</b> <a [^>]+>([^<]+)<", key) == [("1", "mine"), ("2", "expert")]
    assert (
        ">expert<"
        not in re.findall(r'class="chart-key".*?</ol>', page(client, "/?view=radar"), re.DOTALL)[0]
    )


def test_files_are_those_of_what_is_shown(client: TestClient) -> None:
    text = page(client, "/?category=RC&sort=policy&search=mine&verdict=exact")
    files = [link for link in links(text) if "/leaderboard/export" in link]

    assert len(files) == 4
    for link in files:
        assert "category=RC" in link and "sort=policy" in link and "verdict=exact" in link
        content = client.get(link).text
        assert "mine" in content and "expert" not in content.replace("expert's", "")
        assert "swap_square_pegs" not in content or "format=json" in link
    assert any(client.get(link).text.rstrip().endswith(r"\end{table*}") for link in files)


def test_another_suite_has_its_files_and_not_the_papers_table(every_suite: TestClient) -> None:
    text = page(every_suite, "/?suite=hide-hard&verdict=exact")
    files = [link for link in links(text) if "/leaderboard/export" in link]

    assert [link.rpartition("format=")[2] for link in files] == ["csv", "json"]
    for link in files:
        content = every_suite.get(link).text
        assert "suite=hide-hard&verdict=exact" in link and "mine" in content
        assert all(task in content for task in SUITES["hide-hard"])


def test_a_snapshot_is_one_click_away_and_shows_the_same(client: TestClient) -> None:
    text = page(client, "/?view=bars&category=RC")
    [action] = re.findall(r'<form method="post" action="([^"]+)"', text)

    answer = client.post(unescape(action), data={"split": "test"}, follow_redirects=False)

    assert answer.status_code == 303
    there = answer.headers["location"]
    assert re.fullmatch(r"/snapshots/\d+\?category=RC&view=bars", there)
    kept = page(client, there)
    charts = r'<div class="panels.*?</div>'
    assert re.findall(charts, kept, re.DOTALL) == re.findall(charts, text, re.DOTALL)
    assert rows_of(page(client, there.partition("?")[0])) == rows_of(page(client, "/"))


def test_another_suites_board_is_kept_and_shown_as_it_was_taken(every_suite: TestClient) -> None:
    text = page(every_suite, "/?suite=hide-hard&sort=policy")
    [action, form] = re.findall(
        r'<form method="post" action="(/snapshots[^"]*)">(.*?)</form>', text, re.DOTALL
    )[0]
    sent = dict(re.findall(r'name="(\w+)" value="([^"]*)"', form))

    answer = every_suite.post(unescape(action), data=sent, follow_redirects=False)

    there = answer.headers["location"]
    assert re.fullmatch(r"/snapshots/\d+\?sort=policy", there)
    kept = page(every_suite, there)
    assert rows_of(kept) == rows_of(text)
    assert "suite hide-hard, split test, as it stood" in kept
    assert "rinted in the paper" not in kept and 'name="published"' not in kept
    assert '<input type="hidden" name="suite" value="hide-hard">' in kept  # where it is compared
    assert ">hide-hard</td>" in page(every_suite, "/snapshots")


def test_every_suite_has_a_tab_and_a_board_of_its_own(client: TestClient) -> None:
    text = page(client, "/?suite=hide-hard&verdict=exact")
    assert 'href="/?suite=hide-hard&amp;verdict=exact" aria-current="page">hide-hard' in text
    assert '<a href="/?verdict=exact">hide</a>' in text
    assert "suite hide-hard 1" in text and "No complete evaluation" in text


def test_policies_are_ticked_to_be_compared(client: TestClient) -> None:
    text = page(client, "/?verdict=exact")

    boxes = re.findall(r'<input type="checkbox" form="chosen" name="policy" value="([^"]+)"', text)
    assert boxes == ["mine@1", "expert@1"]
    assert 'id="chosen" class="chosen" action="/comparisons" method="get"' in text
    assert '<input type="hidden" name="verdict" value="exact">' in text


def test_the_ticked_are_compared_on_the_suite_where_they_stand(every_suite: TestClient) -> None:
    text = page(every_suite, "/?suite=real4")
    form = text.partition('<form id="chosen"')[2].partition("</form>")[0]
    sent = dict(re.findall(r'<input type="hidden" name="(\w+)" value="([^"]+)">', form))

    assert sent == {"suite": "real4"}
    ticked = sent | {"policy": ["mine@1", "expert@1"]}
    assert "Suite real4 1" in every_suite.get("/comparisons", params=ticked).text
    charted = every_suite.get("/", params=ticked | {"view": "bars"}).text
    assert "suite real4 1" in charted and "Choose policies" in charted


def test_sorted_again_no_line_is_rendered_again(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    page(client, "/")
    rendered: list[str] = []
    part = board.part

    def noted(name: str, shown: Mapping[str, Any]) -> Markup:
        rendered.append(name)
        return part(name, shown)

    monkeypatch.setattr(board, "part", noted)

    page(client, "/?sort=policy")
    page(client, "/?search=mine")
    assert rendered == ["board.html"] * 2
    page(client, "/?category=EPT&verdict=exact")
    assert rendered[2:] == ["board_line.html"] * 2 + ["board.html"]


def test_an_address_says_only_what_is_unusual() -> None:
    wanted = PageQuery(sort="gap", policy=["a b@1", "c+d@2"], split="test")

    assert fields(wanted) == "?sort=gap&policy=a+b%401&policy=c%2Bd%402"
    assert fields(PageQuery(policy=[])) == ""


def test_more_lines_than_are_read_at_once_are_a_click_away(site: Site) -> None:
    with site.hub.database.reading() as session:
        whole = leaderboard.leaderboard(session)
    [mine, *_] = whole.rows
    many = [mine.model_copy(update={"evaluation": f"ev_{n}"}) for n in range(board.LINES + 7)]
    large = whole.model_copy(update={"rows": many})

    some, every = (
        str(Shown(large, PageQuery(policy=[], rows=rows), "large").drawn())
        for rows in ("some", "all")
    )

    assert len(rows_of(some)) == board.LINES and "7 more ranked policies" in some
    assert len(rows_of(every)) == board.LINES + 7 and "Show all" not in every


def test_the_cells_of_a_task_stand_under_its_heading(client: TestClient) -> None:
    """Of the groups of headings, every line has a cell for each column."""
    for path in ("/", "/?category=EPT"):
        text = page(client, path)
        board_of = text[text.index('<table class="board">') : text.index("</table>")]
        lines = re.findall(r"<tr[^>]*>(.*?)</tr>", board_of, re.DOTALL)
        widths = {
            len(re.findall("<t[hd]", line))
            + sum(int(columns) - 1 for columns in re.findall('colspan="([0-9]+)"', line))
            for line in lines
            if 'colspan="99"' not in line
        }
        assert len(widths) == 1, path


def test_the_empty_board_of_another_suite_says_which_it_is(client: TestClient) -> None:
    text = page(client, "/?suite=real4&split=test100")

    [said] = re.findall("<h2 id=.first-title.>(.*?)</h2>", text)
    assert said == "No complete evaluation of suite real4, split test100 yet"
    assert "over its 4 tasks" in text


def test_a_chart_says_how_many_episodes_a_task_has(client: TestClient) -> None:
    assert "25 episodes a task" in page(client, "/?view=tasks")
