"""`hide submit` and `hide watch` as their users meet them, against a real server."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import select

from hide_tasks import SUITES
from server import client as clients
from server.hub import Hub
from server.models import Upload
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.server.clients import served
from tests.server.test_cli import hide
from tests.server.test_client import play

FEW = ("--tasks", "search_drawer", "--episodes", "2")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Hub, str]]:
    with served(tmp_path_factory.mktemp("commands")) as (hub, http):
        yield hub, str(http.base_url)


@pytest.fixture(autouse=True)
def url(server: tuple[Hub, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIDE_URL", server[1])
    monkeypatch.delenv("HIDE_TOKEN", raising=False)


def test_what_is_submitted_is_watched_to_its_end(capfd, server: tuple[Hub, str]) -> None:
    hub, _ = server
    status, output, errors = hide(capfd, "submit", "noop", *FEW)
    evaluation = output.strip()
    play(hub)

    watched, table, lines = hide(capfd, "watch", evaluation)
    _, document, _ = hide(capfd, "watch", evaluation, "--json")

    assert (status, errors) == (0, "") and evaluation.startswith("ev_")
    assert watched == 0 and "2 of 2 episodes" in lines and "completed" in lines
    assert "search_drawer" in table and "100 %" in table and evaluation in table
    assert json.loads(document)["verdicts"]["success"]["successes"] == 2


def test_what_does_not_complete_is_exit_status_1(capfd, server: tuple[Hub, str]) -> None:
    _, url = server
    _, output, _ = hide(capfd, "submit", "noop", *FEW)
    with clients.Client(url) as client:
        client.cancel(output.strip())

    status, _, errors = hide(capfd, "watch", output.strip())

    assert status == 1 and f"{output.strip()} is cancelled" in errors


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("submit", "Missing argument 'POLICY'"),
        ("submit exprt", "did you mean expert?"),
        ("submit nowhere.safetensors", "No checkpoint nowhere.safetensors"),
        ("submit ws://127.0.0.1:1", "--name: ws://127.0.0.1:1 needs a name"),
        ("submit ws:// --name mine", "'ws://' is no URL such as ws://host:8000"),
        ("submit noop --maps maps.toml", "--maps maps.toml: is for ws://host:port"),
        ("submit noop --split best", "--split best: is not one of train, val, test, test100"),
        ("submit noop --episodes 26", "--episodes 26: test has 25 a task"),
        ("submit noop --tasks fly", "No task 'fly'"),
        ("submit noop --category FOO", "--category FOO: no such category; there are RC, HSR, EPT"),
        ("watch ev_nothing", "No evaluation 'ev_nothing'"),
        ("watch ev_nothing --server nowhere", "nowhere is no address such as http://"),
        ("export ev_nothing", "No evaluation 'ev_nothing'"),
        ("export leaderboard --format zip --out x", "is of an evaluation; give json, csv or latex"),
        ("export leaderboard --suite best", "the suites are hide, hide-hard, real4"),
        ("export leaderboard --suite real4 --format latex --out x", "'real4' there are json, csv"),
        ("export ev_1 --suite real4", "--suite real4: is of the leaderboard"),
    ],
)
def test_a_mistake_is_one_clear_line(
    capfd, tmp_path: Path, monkeypatch, arguments: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)

    status, output, errors = hide(capfd, *arguments.split())

    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("hide: ") and message in errors
    assert list(tmp_path.iterdir()) == []


def test_weights_of_another_suite_are_not_uploaded(capfd, tmp_path: Path, server) -> None:
    hub, _ = server
    file = tiny_checkpoint(tmp_path / "other.safetensors", suite="real4")

    status, _, errors = hide(capfd, "submit", str(file))

    assert status == 2
    assert "other was trained on suite real4; these tasks are of hide" in errors
    with hub.database.reading() as session:
        assert not session.scalars(select(Upload)).all()


def test_the_leaderboard_of_a_suite_is_written(capfd) -> None:
    status, output, _ = hide(capfd, "export", "leaderboard", "--suite", "hide-hard")
    _, usual, _ = hide(capfd, "export", "leaderboard")

    assert status == 0
    for text, suite in ((output, "hide-hard"), (usual, "hide")):
        heads = {name.removeprefix("success_") for name in text.splitlines()[0].split(",")}
        assert heads & {*SUITES["hide"], *SUITES["hide-hard"]} == set(SUITES[suite])


def test_a_server_that_is_not_there(capfd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "TRIES", 2)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    status, _, errors = hide(capfd, "watch", "ev_1", "--server", f"http://127.0.0.1:{port}")

    assert status == 1 and "cannot be reached" in errors and errors.count("\n") == 1


def test_a_server_that_wants_a_token(capfd, tmp_path: Path, monkeypatch) -> None:
    with served(tmp_path, token=True) as (hub, http):
        ask = ("submit", "noop", *FEW, "--server", str(http.base_url))
        refused, _, errors = hide(capfd, *ask)
        monkeypatch.setenv("HIDE_TOKEN", str(hub.local_token))
        status, output, _ = hide(capfd, *ask)

    assert refused == 2 and "Set HIDE_TOKEN to a token of yours." in errors
    assert status == 0 and output.startswith("ev_")
