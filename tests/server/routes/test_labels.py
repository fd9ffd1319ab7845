"""Labels and notes on episodes over HTTP."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from fastapi import FastAPI

from tests.server import ledgers
from tests.server.clients import API, TestClient, create, hub_of, problem_of
from tests.server.people import peopled, token_of, visitor


class Labelled(NamedTuple):
    """A server with users, and final episodes."""

    app: FastAPI
    episodes: list[str]

    def by(self, role: str) -> TestClient:
        """A user of this role."""
        return visitor(self.app, token_of(self.app, role))


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Labelled]:
    with peopled(tmp_path) as app:
        hub = app.state.hub
        wanted = {"tasks": ["search_drawer"], "episodes": 3}
        done = ledgers.evaluated(hub.database, hub.blobs, **wanted)
        with hub.database.reading() as session:
            episodes = [one.id for one in ledgers.episodes_of(session, done)]
        yield Labelled(app, episodes)


def say(asking: TestClient, episode: str, **what: str) -> dict:
    answer = asking.post(f"{API}/episodes/{episode}/labels", json=what)
    assert answer.status_code == 201, answer.text
    found: dict = answer.json()
    return found


def test_what_was_said_of_an_episode(site: Labelled) -> None:
    asking = site.by("submitter")

    first = say(asking, site.episodes[0], label="grasp_miss", note="slipped")
    second = say(site.by("maintainer"), site.episodes[0], note="see the wrist camera")

    told = site.by("viewer").get(f"{API}/episodes/{site.episodes[0]}/labels").json()
    assert told == [first, second]
    assert [one["author"] for one in told] == ["submitter", "maintainer"]
    assert [one["label"] for one in told] == ["grasp_miss", None]


def test_episodes_are_found_by_their_labels(site: Labelled) -> None:
    asking = site.by("submitter")
    for episode in site.episodes[:2]:
        say(asking, episode, label="grasp_miss")
    say(asking, site.episodes[0], label="grasp_miss")
    say(asking, site.episodes[2], label="collision")

    found = asking.get(f"{API}/episodes", params={"label": "grasp_miss"}).json()["items"]

    assert {one["id"] for one in found} == set(site.episodes[:2])
    assert asking.get(f"{API}/labels").json() == [
        {"label": "grasp_miss", "episodes": 2},
        {"label": "collision", "episodes": 1},
    ]


def test_a_label_that_is_taken_back_stays_known(site: Labelled) -> None:
    asking = site.by("submitter")
    said = say(asking, site.episodes[0], label="grasp_miss")
    path = f"{API}/labels/{said['id']}/withdrawal"

    first, again = asking.post(path).json(), asking.post(path).json()

    [told] = asking.get(f"{API}/episodes/{site.episodes[0]}/labels").json()
    assert first == again == told
    assert told["withdrawn"] and told["withdrawn_by"] == "submitter"
    assert asking.get(f"{API}/labels").json() == []
    assert asking.get(f"{API}/episodes", params={"label": "grasp_miss"}).json()["items"] == []


def test_others_labels_are_taken_back_by_maintainers(site: Labelled) -> None:
    said = say(site.by("maintainer"), site.episodes[0], label="grasp_miss")
    path = f"{API}/labels/{said['id']}/withdrawal"

    refused, done = site.by("submitter").post(path), site.by("admin").post(path)

    assert refused.status_code == 403 and problem_of(refused)["code"] == "not_yours"
    assert done.json()["withdrawn_by"] == "admin"


@pytest.mark.parametrize(
    ("document", "field"),
    [({}, "note"), ({"note": " "}, "note"), ({"label": "A b"}, "label"), ({"label": ""}, "label"),
     ({"note": "x" * 2001}, "note"), ({"label": "odd", "by": "me"}, "by")],
)  # fmt: skip
def test_what_is_no_label_is_refused(site: Labelled, document: dict, field: str) -> None:
    path = f"{API}/episodes/{site.episodes[0]}/labels"

    answer = site.by("submitter").post(path, json=document)

    assert answer.status_code == 422
    assert [error["field"] for error in problem_of(answer)["errors"]] == [field]


def test_only_final_episodes_have_labels(here: TestClient) -> None:
    evaluation = create(here)["id"]
    with hub_of(here).database.reading() as session:
        [episode, _] = [one.id for one in ledgers.episodes_of(session, evaluation)]

    answer = here.post(f"{API}/episodes/{episode}/labels", json={"label": "odd"})

    assert answer.status_code == 409 and problem_of(answer)["code"] == "not_final"


def test_an_episode_has_so_many_labels(site: Labelled, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.labels.MOST", 3)
    asking = site.by("submitter")
    path = f"{API}/episodes/{site.episodes[0]}/labels"
    statuses = [asking.post(path, json={"label": "odd"}).status_code for _ in range(4)]

    assert statuses == [201] * 3 + [409]


def test_verdicts_stay_as_they_are(site: Labelled) -> None:
    asking = site.by("maintainer")
    before = asking.get(f"{API}/episodes/{site.episodes[0]}").json()

    say(asking, site.episodes[0], label="wrong_count_over", note="this should be a failure")

    assert asking.get(f"{API}/episodes/{site.episodes[0]}").json() == before
