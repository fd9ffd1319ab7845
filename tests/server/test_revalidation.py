"""What a client has already is not sent again."""

from collections.abc import Iterator

import pytest

from tests.server import ledgers
from tests.server.clients import API, TestClient, client, create, hub_of

SAME = ["/tasks", "/policies", "/evaluations", "/leaderboard", "/episodes", "/health/ready"]


@pytest.fixture(scope="module")
def episode(reader: TestClient) -> str:
    items = reader.get(f"{API}/episodes").json()["items"]
    return str(items[0]["id"])


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A server whose leaderboard has a row."""
    with client(tmp_path_factory.mktemp("heavy")) as found:
        hub = hub_of(found)
        ledgers.registered(hub.database, "mine")
        ledgers.evaluated(hub.database, hub.blobs, "mine")
        yield found


@pytest.mark.parametrize("path", SAME)
def test_the_same_answer_is_not_sent_twice(reader: TestClient, path: str) -> None:
    first = reader.get(API + path)
    tag = first.headers["etag"]

    again = reader.get(API + path, headers={"If-None-Match": tag})

    assert first.status_code == 200 and first.json()
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == tag
    assert again.headers["cache-control"] == "private, no-cache"


@pytest.mark.parametrize("what", ["", "/decisions", "/changes", "/spans"])
def test_what_was_measured_of_an_episode_is_not_sent_twice(
    reader: TestClient, episode: str, what: str
) -> None:
    path = f"{API}/episodes/{episode}{what}"
    tag = reader.get(path).headers["etag"]

    assert reader.get(path, headers={"If-None-Match": tag}).status_code == 304


@pytest.mark.parametrize("shown", ['"other"', "nonsense", "", '"", W/"x"'])
def test_another_tag_gets_the_whole_answer(reader: TestClient, shown: str) -> None:
    answer = reader.get(f"{API}/leaderboard", headers={"If-None-Match": shown})

    assert answer.status_code == 200 and answer.json()["columns"]


@pytest.mark.parametrize("around", ["{}", "W/{}", '"x", {}', '"x" , W/{} ,"y"'])
def test_a_tag_is_known_among_others(reader: TestClient, around: str) -> None:
    tag = reader.get(f"{API}/leaderboard").headers["etag"]

    answer = reader.get(f"{API}/leaderboard", headers={"If-None-Match": around.format(tag)})

    assert answer.status_code == 304


def test_a_changed_leaderboard_has_another_tag(heavy: TestClient) -> None:
    hub = hub_of(heavy)
    before = heavy.get(f"{API}/leaderboard")
    tags = {"If-None-Match": before.headers["etag"]}
    assert heavy.get(f"{API}/leaderboard", headers=tags).status_code == 304

    ledgers.registered(hub.database, "other")
    ledgers.evaluated(hub.database, hub.blobs, "other")
    after = heavy.get(f"{API}/leaderboard", headers=tags)

    assert after.status_code == 200
    assert len(after.json()["rows"]) == len(before.json()["rows"]) + 1


def test_each_question_has_its_own_tag(heavy: TestClient) -> None:
    tags = [
        heavy.get(f"{API}/leaderboard", params=query).headers["etag"]
        for query in ({}, {"verdict": "exact"}, {"split": "val"})
    ]

    assert len(set(tags)) == 3


def test_an_evaluation_that_went_on_is_sent(here: TestClient) -> None:
    evaluation = create(here)["id"]
    path = f"{API}/evaluations/{evaluation}"
    tag = {"If-None-Match": here.get(path).headers["etag"]}
    assert here.get(path, headers=tag).status_code == 304

    here.post(f"{path}/cancellation")

    assert here.get(path, headers=tag).json()["state"] == "cancelled"


def test_a_problem_and_a_change_have_no_tag(here: TestClient) -> None:
    wrong = here.get(f"{API}/evaluations/ev_x", headers={"If-None-Match": "*"})
    made = here.post(f"{API}/evaluations", json={"policy": "noop", "suite": "smoke"})

    assert wrong.status_code == 404 and "etag" not in wrong.headers
    assert made.status_code == 202 and "etag" not in made.headers


def test_a_snapshot_never_has_to_be_asked_for_again(heavy: TestClient) -> None:
    path = heavy.post(f"{API}/leaderboard/snapshots", json={}).json()["content"]
    first = heavy.get(path)

    again = heavy.get(path, headers={"If-None-Match": first.headers["etag"]})

    assert "immutable" in first.headers["cache-control"]
    assert again.status_code == 304
