"""The trained checkpoints that come with the code are the server's own policies."""

import logging
import os
from base64 import b64encode
from pathlib import Path
from typing import Any

import pytest

from seek_model import trained
from server import policies, quotas
from server.backup import back_up, restore
from server.hub import Hub
from server.models import Policy, new_id
from server.read_only import ReadOnlyFolder
from server.retention import prune_orphans
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.seek_model.tiny import tiny
from tests.server import ledgers, people
from tests.server.clients import API, TestClient, client, hub_of, problem_of
from tests.server.running import RunningServer
from tests.workers import checkpoint_files
from workers.checkpoint_cache import FOLDER
from workers.policies import hash_of_file
from workers.protocol import BuiltInPolicy

NOOP = {"kind": "builtin", "name": "noop"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What came along: both policies and what they were trained from."""
    (path := tmp_path / "trained").mkdir()
    for name in trained.NAMES:
        checkpoint_files.written(trained.path_of(name, path), name=name)
    return path


def versions(here: TestClient) -> list[dict[str, Any]]:
    """Of the trained policies, the oldest first."""
    found = here.get(f"{API}/policies", params={"limit": 50}).json()["items"]
    return [one for one in reversed(found) if one["policy"] in trained.NAMES]


def started(data: Path, folder: Path) -> list[dict[str, Any]]:
    """What is there after a start."""
    with client(data, trained=folder) as here:
        return versions(here)


def test_they_are_there_from_the_start_and_nobodys(tmp_path: Path, folder: Path) -> None:
    with client(tmp_path / "data", trained=folder) as here:
        found, hub = versions(here), hub_of(here)
        with hub.database.reading() as session:
            assert quotas.stored(session, hub.owner_id) == 0

    assert [one["policy"] for one in found] == list(trained.POLICIES)
    for one in found:
        file = trained.path_of(one["policy"], folder)
        assert one["spec"]["sha256"] == hash_of_file(file)
        assert hub.blobs.path(one["spec"]["sha256"]).read_bytes() == file.read_bytes()
        assert (one["owner"], one["reference"], one["version"]) == (None, False, 1)
        assert one["facts"]["preset"] == one["policy"]
        assert one["description"] == trained.ABOUT[one["policy"]]


def test_the_same_files_change_nothing_and_another_is_the_next_version(
    tmp_path: Path, folder: Path
) -> None:
    first = started(tmp_path / "data", folder)
    assert started(tmp_path / "data", folder) == first

    newer = checkpoint_files.written(trained.path_of("seek-small", folder), name="seek-small+clock")
    found = started(tmp_path / "data", folder)

    assert found[:2] == first
    [added] = found[2:]
    assert (added["policy"], added["version"]) == ("seek-small", 2)
    assert (added["spec"]["sha256"], added["facts"]["preset"]) == (
        hash_of_file(newer),
        "seek-small+clock",
    )


def test_a_release_without_them_keeps_those_that_were_there(tmp_path: Path, folder: Path) -> None:
    first = started(tmp_path / "data", folder)

    assert started(tmp_path / "data", tmp_path / "nowhere") == first


def test_a_file_that_was_lost_is_there_again(tmp_path: Path, folder: Path) -> None:
    with client(tmp_path / "data", trained=folder) as here:
        blob = hub_of(here).blobs.path(versions(here)[0]["spec"]["sha256"])
    blob.unlink()

    started(tmp_path / "data", folder)

    assert blob.exists()


def test_a_damaged_file_is_left_out_and_told(
    tmp_path: Path, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    trained.path_of("seek-small", folder).write_bytes(b"version https://git-lfs.github.com")

    with caplog.at_level(logging.WARNING):
        found = started(tmp_path / "data", folder)

    assert [one["policy"] for one in found] == ["sam2act-small"]
    assert "The trained policy seek-small is left out: no safetensors file" in caplog.text


@pytest.mark.parametrize("name", trained.POLICIES)
def test_their_names_are_reserved_even_where_they_did_not_come_along(
    here: TestClient, name: str
) -> None:
    spec, content = {"name": name, "spec": NOOP}, checkpoint_files.content()
    begun = {
        "Tus-Resumable": "1.0.0",
        "Upload-Length": "9",
        "Upload-Metadata": f"name {b64encode(name.encode()).decode()}",
    }

    answers = [
        here.post(f"{API}/policies", json=spec),
        here.post(f"{API}/policies/checkpoints", params={"name": name}, content=content),
        here.post(f"{API}/uploads", headers=begun),
    ]

    for answer in answers:
        told = problem_of(answer)
        assert (told["status"], told["errors"][0]["field"]) == (422, "name")
        assert (
            f"a trained policy that comes along; choose another name, such as my-{name}"
            in (told["detail"])
        )


def test_a_name_that_somebody_took_before_stays_theirs(
    tmp_path: Path, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with client(tmp_path / "data") as here:
        taken_before(hub_of(here), "seek-small")

    with caplog.at_level(logging.WARNING), client(tmp_path / "data", trained=folder) as here:
        found = versions(here)
        again = here.post(f"{API}/policies", json={"name": "seek-small", "spec": NOOP})

    assert [one["policy"] for one in found] == ["seek-small", "sam2act-small"]
    assert found[0]["spec"]["kind"] == "builtin"
    assert "'seek-small' is a user's policy here" in caplog.text
    assert (again.status_code, again.json()["version"]) == (201, 2)


def taken_before(hub: Hub, name: str) -> None:
    """The owner's policy of a release that had no trained ones."""
    with hub.database.writing() as session:
        policy = Policy(id=new_id("po"), name=name, owner_id=hub.owner_id)
        session.add(policy)
        session.flush()
        policies.register(session, name, BuiltInPolicy(name="noop"))


def test_users_may_evaluate_them_and_add_no_version(tmp_path: Path, folder: Path) -> None:
    with people.peopled(tmp_path / "data", trained=folder) as app:
        ann = people.visitor(app, people.token_of(app, "submitter"))
        asked = {"policy": "seek-small", "tasks": ["search_drawer"], "episodes": 1}

        begun = ann.post(f"{API}/evaluations", json=asked)
        refused = ann.post(f"{API}/policies", json={"name": "seek-small", "spec": NOOP})
        admin = people.visitor(app, people.token_of(app, "admin"))
        by_admin = admin.post(f"{API}/policies", json={"name": "seek-small", "spec": NOOP})

    assert begun.status_code == 202, begun.text
    assert (refused.status_code, by_admin.status_code) == (422, 422)


def test_they_are_ranked_and_no_references(tmp_path: Path, folder: Path) -> None:
    with client(tmp_path / "data", trained=folder) as here:
        hub = hub_of(here)
        ledgers.evaluated(hub.database, hub.blobs, "seek-small")
        ledgers.evaluated(hub.database, hub.blobs, "expert")
        rows = here.get(f"{API}/leaderboard").json()["rows"]

    assert [(one["policy"], one["rank"], one["reference"]) for one in rows] == [
        ("seek-small", 1, False),
        ("expert", None, True),
    ]


def test_an_episode_of_theirs_is_played_again_by_name(tmp_path: Path, folder: Path) -> None:
    with client(tmp_path / "data", trained=folder) as here:
        hub = hub_of(here)
        evaluation = ledgers.evaluated(
            hub.database, hub.blobs, "seek-small", tasks=["search_drawer"], episodes=1
        )
        [episode] = here.get(f"{API}/evaluations/{evaluation}/episodes").json()["items"]
        told = here.get(f"{API}/episodes/{episode['id']}/rerun").json()

    assert told["command"].startswith("hide eval seek-small --tasks search_drawer")
    sha256 = hash_of_file(trained.path_of("seek-small", folder))
    assert any("comes with HIDE-SEEK" in note and sha256 in note for note in told["notes"])


def test_they_outlive_pruning_backup_and_restoration(tmp_path: Path, folder: Path) -> None:
    data = tmp_path / "data"
    with client(data, trained=folder) as here:
        first, hub = versions(here), hub_of(here)
        for one in first:
            os.utime(hub.blobs.path(one["spec"]["sha256"]), (0, 0))  # it came long ago
        assert prune_orphans(hub.database, hub.blobs) == []
    with ReadOnlyFolder.opened(data) as source:
        copied = back_up(source, tmp_path / "backup")
    restore(tmp_path / "backup", tmp_path / "restored")

    assert (copied.files, copied.faults) == (2, [])
    with client(tmp_path / "restored", trained=tmp_path / "nowhere") as here:
        assert versions(here) == first
        assert all(hub_of(here).blobs.holds(one["spec"]["sha256"]) for one in first)


@pytest.mark.slow
def test_a_trained_policy_is_played_by_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path / "cache"))
    (path := tmp_path / "trained").mkdir()
    tiny_checkpoint(trained.path_of("seek-small", path), tiny())
    with RunningServer(tmp_path / "data", "--no-references", workers=1, trained=path) as server:
        wanted = {"policy": "seek-small", "tasks": ["push_button_times"], "episodes": 1}
        evaluation = server.post("/evaluations", wanted)["id"]
        done = server.finished(evaluation)
        [episode] = server.episodes(evaluation)

    assert done["state"] == "completed"
    assert episode["failure"] != "policy_error"
