"""What is compressed on its way, and what never is."""

import pytest
from fastapi.testclient import TestClient

from tests.web.sites import Site


@pytest.mark.parametrize("path", ["/", "/api/v1/evaluations", "/static/css/base.css"])
def test_text_is_compressed_for_who_takes_it(client: TestClient, path: str) -> None:
    answer = client.get(path, headers={"Accept-Encoding": "gzip"})
    plain = client.get(path, headers={"Accept-Encoding": "identity"})

    assert answer.headers["Content-Encoding"] == "gzip"
    assert "Accept-Encoding" in answer.headers["Vary"]
    assert answer.content == plain.content
    assert "Content-Encoding" not in plain.headers


def test_a_page_for_somebody_who_signed_in_is_not(client: TestClient) -> None:
    answer = client.get("/", headers={"Accept-Encoding": "gzip", "Cookie": "hide=secret"})

    assert "Content-Encoding" not in answer.headers


@pytest.mark.parametrize("what", ["recording.rrd", "preview.webp", "thumbnail.jpg"])
def test_what_is_compact_already_is_sent_as_it_is(
    client: TestClient, site: Site, what: str
) -> None:
    [id] = site.episodes(site.recorded)

    answer = client.get(f"/api/v1/episodes/{id}/{what}", headers={"Accept-Encoding": "gzip"})

    assert answer.status_code == 200
    assert "Content-Encoding" not in answer.headers
