"""`hide verify` and what keeps a server's data, as a user meets them."""

import json
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
