"""What keeps other sites' pages and other hosts' names away from a server without log-in."""

from collections.abc import Iterator

import pytest

from server import guard
from tests.server.clients import API, TestClient, client

EVALUATION = {"policy": "expert", "tasks": ["search_drawer"], "episodes": 1}


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with client(tmp_path_factory.mktemp("guard")) as found:
        yield found


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8000", "localhost:8000", "LOCALHOST", "[::1]:8000", "[::1]"]
)
def test_loopback_under_every_name(here: TestClient, host: str) -> None:
    assert here.get(f"{API}/version", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1.evil.example",
        "evil.example:127.0.0.1",
        "localhost@evil.example",
        "0.0.0.0",
        "",
        ":8000",
        "[::1",
        "[evil]",
        "127.0.0.1:8000/x",
        "127.0.0.1 evil.example",
    ],
)
@pytest.mark.parametrize("path", [f"{API}/version", "/nowhere", f"{API}/evaluations/x/events"])
def test_another_host_is_refused(here: TestClient, host: str, path: str) -> None:
    answer = here.get(path, headers={"Host": host})

    assert answer.status_code == 421 or (host == "127.0.0.1:8000/x" and answer.status_code < 500)
    if answer.status_code == 421:
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["code"] == "wrong_host"


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Origin": "null"},
        {"Origin": ""},
        {"Origin": "http://["},
        {"Origin": "127.0.0.1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Sec-Fetch-Site": "whatever"},
        {"Origin": "http://127.0.0.1", "Sec-Fetch-Site": "cross-site"},
    ],
)
@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_other_sites_change_nothing(here: TestClient, headers: dict[str, str], method: str) -> None:
    answer = here.request(method, f"{API}/evaluations", json=EVALUATION, headers=headers)

    assert (answer.status_code, answer.json()["code"]) == (403, "cross_site")
    assert answer.headers["content-type"] == "application/problem+json"
    assert here.get(f"{API}/evaluations").json()["items"] == []


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Origin": "http://127.0.0.1"},
        {"Sec-Fetch-Site": "same-origin"},
        {"Sec-Fetch-Site": "none"},
    ],
)
def test_the_own_pages_and_programs_may_ask_for_changes(
    here: TestClient, headers: dict[str, str]
) -> None:
    wrong = {"policy": "nobody"}

    answer = here.post(f"{API}/evaluations", json=wrong, headers=headers)

    assert answer.status_code == 422


def test_reading_from_another_sites_link_is_fine(here: TestClient) -> None:
    answer = here.get(f"{API}/version", headers={"Sec-Fetch-Site": "cross-site"})

    assert answer.status_code == 200


def test_too_large_a_body_is_refused(here: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST", 1000)
    headers = {"Content-Type": "application/json"}

    answer = here.post(f"{API}/evaluations", content=b" " * 1001, headers=headers)

    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    assert "at most 1000 bytes" in answer.json()["detail"]


def test_too_large_a_body_in_pieces_is_refused(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "MOST", 1000)
    headers = {"Content-Type": "application/json"}

    answer = here.post(f"{API}/evaluations", content=iter([b" " * 400] * 3), headers=headers)

    assert answer.status_code == 413


def test_a_body_of_the_largest_size_is_read(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "MOST", 1000)
    body = b'{"policy": "nobody"}'.ljust(1000)

    answer = here.post(
        f"{API}/evaluations", content=body, headers={"Content-Type": "application/json"}
    )

    assert answer.status_code == 422
