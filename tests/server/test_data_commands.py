"""`hide verify` and what keeps a server's data, as a user meets them."""

import json
import os
from pathlib import Path

import pytest

from server.blobs import Blobs
from tests.server import ledgers, tampering
from tests.server.test_cli import hide


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A stopped server's folder with one evaluation of one episode."""
    folder = tmp_path / "data"
    database = ledgers.opened(folder)
    ledgers.evaluated(database, Blobs(folder / "blobs"), tasks=["search_drawer"], episodes=1)
    database.close()
    return folder


def test_what_agrees(capfd, data: Path) -> None:
    status, output, _ = hide(capfd, "verify", "--data", data, "--sample", 0)

    assert status == 0
    assert "success 1 of 1, exact 1 of 1" in output
    assert "1 evaluations, 1 episodes, 1 files; 0 episodes played again" in output
    assert output.endswith("Everything agrees.\n")


def test_what_does_not_agree(capfd, data: Path) -> None:
    tampering.alter(data, "UPDATE episodes SET final_state_hash = 'e'")

    status, output, _ = hide(capfd, "verify", "--data", data, "--sample", 0)
    as_json = hide(capfd, "verify", "--data", data, "--sample", 0, "--json")

    document = json.loads(as_json[1])
    assert (status, as_json[0]) == (1, 1)
    assert "MISMATCH ep_" in output and "digest: stored " in output
    assert output.endswith("1 mismatches\n")
    assert (document["good"], document["mismatches"][0]["what"]) == (False, "digest")
    assert document["mismatches"][0]["stored"] != document["mismatches"][0]["found"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("verify", "--data", "nowhere"), "nowhere is no data folder of a server"),
        (("verify", "nowhere"), "nowhere is no run's folder"),
        (("backup", "copy", "--data", "nowhere"), "nowhere is no data folder of a server"),
        (("restore", "nowhere", "--data", "new"), "nowhere is no backup"),
        (("prune", "--data", "nowhere"), "nowhere is no data folder of a server"),
        (("verify", "--sample", "many"), "--sample many: give a number"),
    ],
)
def test_a_mistake_is_one_clear_line(
    capfd, tmp_path: Path, monkeypatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)

    status, output, errors = hide(capfd, *arguments)

    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert message in errors
    assert list(tmp_path.iterdir()) == []


def test_an_evaluation_that_is_not_there(capfd, data: Path) -> None:
    status, output, errors = hide(capfd, "verify", "ev_0", "--data", data)

    assert (status, output) == (2, "")
    assert "has no evaluation ev_0" in errors


def test_a_backup_and_what_is_made_of_it(capfd, data: Path, tmp_path: Path) -> None:
    copy, restored = tmp_path / "copy", tmp_path / "restored"

    made = hide(capfd, "backup", copy, "--data", data)
    back = hide(capfd, "restore", copy, "--data", restored)
    again = hide(capfd, "restore", copy, "--data", restored)
    agrees = hide(capfd, "verify", "--data", restored, "--sample", 0)

    assert (made[0], back[0], again[0], agrees[0]) == (0, 0, 2, 0)
    assert f"{copy}: the ledger of 20" in made[1] and "and 1 files" in made[1]
    assert "holds something; move it away" in again[2]


def test_a_damaged_file_is_left_out_and_told(capfd, data: Path, tmp_path: Path) -> None:
    [[sha256]] = tampering.ask(data, "SELECT sha256 FROM blobs")
    tampering.edit_blob(data, sha256)

    status, output, errors = hide(capfd, "backup", tmp_path / "copy", "--data", data)

    assert status == 1
    assert "and 0 files" in output
    assert f"left out: {sha256}: is damaged" in errors


def test_pruning_lists_first_and_removes_then(capfd, data: Path) -> None:
    store = Blobs(data / "blobs")
    orphan = store.put(b"of a lost attempt")
    os.utime(store.path(orphan), (0, 0))

    listed = hide(capfd, "prune", "--data", data, "--above", 0, "--orphans", "--dry-run")
    assert store.holds(orphan)
    removed = hide(capfd, "prune", "--data", data, "--above", 0, "--orphans")

    assert (listed[0], removed[0]) == (0, 0)
    assert f"orphan {store.path(orphan)} 17 bytes" in listed[1]
    assert "0 recordings would be removed" in listed[1]
    assert "1 files that nothing names, 17 bytes: removed" in removed[1]
    assert not store.holds(orphan)
    assert hide(capfd, "verify", "--data", data, "--sample", 0)[0] == 0
