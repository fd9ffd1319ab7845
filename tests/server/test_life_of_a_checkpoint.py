"""A checkpoint from its upload to the recording of what it remembered, with real processes."""

from pathlib import Path

import pytest

from hide_tasks import load
from hide_tasks.contract import Category
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.server.running import RunningServer
from workers.checkpoint_cache import FOLDER
from workers.recording import properties_of


@pytest.mark.slow
def test_a_checkpoint_is_uploaded_played_and_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path / "cache"))
    content = tiny_checkpoint(tmp_path / "tiny.safetensors").read_bytes()
    with RunningServer(tmp_path / "data", "--no-references", workers=1) as server:
        address = "/api/v1/policies/checkpoints"
        answer = server.client.post(address, params={"name": "seek"}, content=content, timeout=200)
        assert answer.status_code == 201, answer.text

        evaluation = answer.json()["smoke"]  # begins by itself
        done = server.finished(evaluation)
        episodes = server.episodes(evaluation)
        episode = episodes[0]
        recording = server.client.get(episode["recording"]).content
        spans = server.get(f"/episodes/{episode['id']}/spans")

    assert (done["state"], done["covers"]) == ("completed", "smoke")
    assert {load(one["task"]).category for one in episodes} == set(Category)
    assert not any(one["failure"] == "policy_error" for one in episodes)
    believed = {span["name"] for span in spans if span["kind"] == "belief"}
    assert {"stage_count", "window", "top looks at"} <= believed
    (tmp_path / "a.rrd").write_bytes(recording)
    assert properties_of(tmp_path / "a.rrd")["policy"] == "seek@1"
    sha256 = answer.json()["spec"]["sha256"]
    assert (tmp_path / "cache" / f"{sha256}.safetensors").read_bytes() == content
