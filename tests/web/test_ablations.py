"""The page of the ablations: our figures, the paper's beside them, and what to train next."""

import re
from collections.abc import Iterator
from html import unescape

import pytest
from fastapi import FastAPI

from hide_tasks.contract import EpisodeSpec, Failure
from tests.server import ledgers
from tests.web import sites
from tests.web.conftest import TestClient


def failing(below: int) -> ledgers.Outcomes:
    """Every episode with a smaller index fails."""

    def outcome(spec: EpisodeSpec) -> Failure | None:
        return Failure.UNDERCOUNT if spec.index < below else None

    return outcome


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    app = sites.empty(tmp_path_factory.mktemp("ablations"))
    hub = app.state.hub
    for name, model, below in (
        ("whole", "seek-small", 2),
        ("whole", "seek-small", 4),
        ("short", "seek-small/length_0", 12),
        ("<b>bold</b>", "seek-small/wcm", 9),
    ):
        ledgers.uploaded(hub.database, hub.blobs, name, b"weights", model=model)
        ledgers.evaluated(hub.database, hub.blobs, name, failing(below))
    yield app
    hub.stop()


@pytest.fixture
def client(app: FastAPI) -> TestClient:
    return TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)


def section(text: str, title: str) -> str:
    """The part of the page under a heading."""
    return text.partition(f">{title}</h2>")[2].partition("</section>")[0]


def line(part: str, label: str) -> str:
    """A line of a table, by what it is called."""
    found = re.search(rf'<th scope="row">{re.escape(label)}</th>.*?</tr>', part, re.DOTALL)
    assert found, label
    return found[0]


def test_a_line_shows_our_mean_the_papers_figure_and_each_version(client: TestClient) -> None:
    part = section(unescape(client.get("/ablations").text), "Memory content and length")

    whole = line(part, "6")
    assert "<b>88\N{NARROW NO-BREAK SPACE}%</b>" in whole and "n 375" in whole
    assert "paper 62.9" in whole and "mean of 2" in whole
    assert len(re.findall(r'href="/evaluations/ev_\w+">whole', whole)) == 2
    assert "length 0" in whole and "<b>+36</b>" in whole and "p " in whole


def test_an_empty_line_says_what_to_train(client: TestClient) -> None:
    text = unescape(client.get("/ablations").text)
    other = unescape(client.get("/ablations?size=paper&clock=true").text)

    part = section(text, "Memory content and length")
    assert "hide train seek-small/length_2 --data demos" in line(part, "2")
    assert "paper 53.7" in line(part, "2")
    assert "hide train sam2act-paper+clock --data demos" in other
    assert "Nothing of this is measured here yet" in other


def test_the_curve_has_measured_points_and_the_papers_dashed(client: TestClient) -> None:
    part = section(unescape(client.get("/ablations").text), "Memory content and length")

    curve = re.findall(r'<svg class="length-curve overall".*?</svg>', part, re.DOTALL)[0]
    assert curve.count('class="mark"') == 2
    [published] = re.findall(r'<polyline class="published" points="([^"]+)"', curve)
    assert len(published.split()) == 4
    assert "length 0 52 %" in curve and "length 2 not measured, paper 53.7 %" in curve


def test_one_of_each_line_is_compared_episode_by_episode(client: TestClient) -> None:
    part = section(unescape(client.get("/ablations").text), "Memory content and length")

    [address] = re.findall(r'href="(/comparisons\?[^"]+)"', part)
    compared = client.get(address)

    assert compared.status_code == 200 and "whole" in compared.text and "short" in compared.text


def test_names_of_policies_are_text(client: TestClient) -> None:
    text = client.get("/ablations").text

    assert "<b>bold</b>" not in text and "&lt;b&gt;bold&lt;/b&gt;" in text


@pytest.mark.parametrize("query", ["size=large", "clock=late", "verdict=both", "split=best"])
def test_a_wrong_question_is_refused_with_a_page(client: TestClient, query: str) -> None:
    answer = client.get(f"/ablations?{query}")

    assert answer.status_code == 422
    assert answer.headers["content-type"].startswith("text/html")
