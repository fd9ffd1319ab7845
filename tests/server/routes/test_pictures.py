"""Pictures of an episode: previews, and what each camera saw."""

import io
from pathlib import Path

import pytest
from PIL import Image

from hide_tasks.contract import CAMERAS
from tests.server import ledgers, played
from tests.server.clients import API, TestClient, hub_of
from tests.server.clients import client as serving
from tests.web.sites import Site


@pytest.fixture
def client(site: Site) -> TestClient:
    return TestClient(site.app, base_url="http://127.0.0.1")


def path(site: Site) -> str:
    [id] = site.episodes(site.recorded)
    return f"/api/v1/episodes/{id}"


def test_a_preview_has_a_frame_for_each_decision(site: Site, client: TestClient) -> None:
    count = client.get(path(site)).json()["decisions"]

    answer = client.get(client.get(path(site)).json()["preview"])

    with Image.open(io.BytesIO(answer.content)) as moving:
        assert (moving.format, moving.size) == ("WEBP", (128, 128))
        assert getattr(moving, "n_frames", 1) == count + 1
    assert "immutable" in answer.headers["Cache-Control"]


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_has_a_picture_of_every_decision_and_the_end(
    site: Site,
    client: TestClient,
    camera: str,
) -> None:
    count = client.get(path(site)).json()["decisions"]

    seen = [
        client.get(f"{path(site)}/observations/{k}/{camera}.jpg").content for k in range(count + 1)
    ]

    assert {Image.open(io.BytesIO(one)).size for one in seen} == {(128, 128)}
    assert len(set(seen)) > 2
    beyond = client.get(f"{path(site)}/observations/{count + 1}/{camera}.jpg")
    assert beyond.status_code == 404
    assert f"there are 0 to {count}" in beyond.json()["detail"]


@pytest.mark.parametrize("what", ["observations/0/behind.jpg", "observations/-1/front.jpg"])
def test_a_picture_that_cannot_be_is_refused(site: Site, client: TestClient, what: str) -> None:
    assert client.get(f"{path(site)}/{what}").status_code == 422


def test_an_episode_without_a_recording_has_none(site: Site, client: TestClient) -> None:
    [id, *_] = site.episodes(site.completed)

    assert client.get(f"/api/v1/episodes/{id}").json()["preview"] is None
    assert client.get(f"/api/v1/episodes/{id}/preview.webp").status_code == 404
    assert client.get(f"/api/v1/episodes/{id}/observations/0/front.jpg").status_code == 404


def test_an_episode_is_held_against_the_experts(site: Site, client: TestClient) -> None:
    [id, *_] = site.episodes(site.completed)

    [run] = client.get(f"/api/v1/episodes/{id}/runs").json()
    found = client.get(f"/api/v1/episodes/{id}/parting").json()

    assert run["policy"] == "expert"
    assert found["other"] == run["episode"]
    again = client.get(f"/api/v1/episodes/{id}/parting", params={"other": run["episode"]})
    assert again.json() == found
    elsewhere = client.get(f"/api/v1/episodes/{id}/parting", params={"other": id[:-1] + "x"})
    assert elsewhere.status_code == 404


def test_a_camera_that_its_task_does_not_have_is_not_there(tmp_path: Path) -> None:
    with serving(tmp_path) as here:
        hub = hub_of(here)
        run = played.evaluated(hub.database, hub.blobs, "expert", task="real_push_button_times")
        with hub.database.reading() as session:
            [episode] = ledgers.episodes_of(session, run)
            seen = f"{API}/episodes/{episode.id}/observations/0"
        there, absent = (here.get(f"{seen}/{camera}.jpg") for camera in ("front", "wrist"))

    assert there.status_code == 200
    assert absent.status_code == 404
    assert absent.json()["detail"] == (
        "real_push_button_times has no camera wrist; it is seen through front."
    )
