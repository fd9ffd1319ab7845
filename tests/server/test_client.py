"""The typed client against a real server, also over connections that are cut."""

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from server import client as clients
from server.client import Client, Happening, ServerProblem, Unreachable
from server.hub import Hub
from server.states import EvaluationState
from tests.processes import wait_for
from tests.server import ledgers
from tests.server.clients import served
from tests.server.cuts import cut_way
from tests.server.running import RunningServer
from workers.protocol import BuiltInPolicy

SMALL = {"tasks": ["search_drawer"], "episodes": 7}


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Hub, str]]:
    with served(tmp_path_factory.mktemp("client")) as (hub, http):
        yield hub, str(http.base_url)


@pytest.fixture
def hub(running: tuple[Hub, str]) -> Hub:
    return running[0]


@pytest.fixture
def here(running: tuple[Hub, str]) -> Iterator[Client]:
    with Client(running[1]) as client:
        yield client


def play(hub: Hub) -> None:
    """All shards that wait, one transaction each, as results come in."""
    more = True
    while more:
        with hub.database.writing() as session:
            more = ledgers.play_shard(session, hub.blobs)


def test_what_can_be_no_token_is_said_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="the token is none of a server"):
        Client("http://127.0.0.1:8000", token="hide_\u2026")


def test_what_is_asked_for_comes_back_typed(here: Client, hub: Hub) -> None:
    spec = BuiltInPolicy(name="noop")
    version = here.register("mine", spec, "does nothing")

    queued = here.evaluate("mine", **SMALL)
    play(hub)
    done = here.wait(queued.id)

    assert (version.policy, version.spec, version.description) == ("mine", spec, "does nothing")
    assert here.policy(version.id) == here.policy("mine@1") == version
    assert (queued.state, done.state) == (EvaluationState.QUEUED, EvaluationState.COMPLETED)
    assert done.verdicts.success.value == 1.0 and done.progress.final == 7
    assert [one.id for one in here.evaluations(policy="mine")] == [done.id]
    [first, *_] = here.episodes(done.id)
    assert here.episode(first.id).scene_hash == first.scene_hash
    assert [one.decision for one in here.decisions(first.id)] == [0, 1, 2]
    assert here.changes(first.id)[0].stage == "press 1"
    assert len(here.attempts(done.id)) == 2 and here.failures(done.id) == []
    assert here.me().name == "owner" and len(here.tasks()) == 15
    assert here.leaderboard(verdict="exact").verdict == "exact"


def test_the_same_key_gives_the_same_evaluation(here: Client) -> None:
    first, again, other = (here.evaluate("noop", key=key, **SMALL).id for key in "aab")

    assert first == again != other


def test_many_are_asked_for_at_once(here: Client) -> None:
    batch = here.evaluate_many([{"policy": "noop", **SMALL}, {"policy": "nobody"}])

    assert [one.status for one in batch.items] == [202, 422]
    assert here.cancel(batch.items[0].evaluation.id).state == EvaluationState.CANCELLED


def test_every_page_of_a_list_is_read(here: Client) -> None:
    whole = here.evaluate("noop")

    found = [one.id for one in here.episodes(whole.id, limit=150)]

    assert len(found) == len(set(found)) == 375
    here.cancel(whole.id)


def test_what_the_server_refuses_says_why(here: Client) -> None:
    with pytest.raises(ServerProblem, match="did you mean expert") as wrong:
        here.evaluate("exprt")
    with pytest.raises(ServerProblem, match="No evaluation 'x y'"):
        here.evaluation("x y")
    with pytest.raises(ServerProblem) as unknown:
        here.evaluation("../tasks")
    with pytest.raises(ServerProblem) as resumed:
        here.resume(here.evaluate("noop", **SMALL).id)

    assert (wrong.value.status, wrong.value.code) == (422, "invalid")
    assert [one["field"] for one in wrong.value.errors] == ["policy"]
    assert unknown.value.status == 404
    assert resumed.value.code == "not_incomplete"


def test_a_server_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "TRIES", 2)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nowhere = f"http://127.0.0.1:{free.getsockname()[1]}"

    with Client(nowhere) as client, pytest.raises(Unreachable, match="cannot be reached"):
        client.me()


def test_a_token_lets_in(tmp_path: Path) -> None:
    with served(tmp_path, token=True) as (hub, http):
        with Client(str(http.base_url), hub.local_token) as known:
            assert known.me().via == "local"
        with (
            Client(str(http.base_url), "hide_wrong") as stranger,
            pytest.raises(ServerProblem) as no,
        ):
            stranger.me()

    assert no.value.status == 401


def test_events_go_on_where_the_connection_was_cut(
    running: tuple[Hub, str], here: Client, hub: Hub
) -> None:
    evaluation = here.evaluate("noop", **SMALL).id
    playing = threading.Timer(0.3, play, [hub])
    playing.start()

    with cut_way(running[1], 900, 1500, 2500, 10**9) as way, Client(way.url) as far:
        told: list[Happening] = list(far.events(evaluation))
    playing.join()

    numbers = [one.number for one in told if one.number is not None]
    whole = [one.number for one in here.events(evaluation) if one.number is not None]
    assert way.cuts >= 2
    assert numbers == sorted(set(numbers)) == whole
    assert told[-1].data["progress"]["final"] == 7
    ends = [one.data["state"] for one in told if one.kind == "evaluation"]
    assert ends == ["queued", "running", "completed"]


def test_events_of_what_has_ended_are_told_from_a_number_on(here: Client, hub: Hub) -> None:
    evaluation = here.evaluate("noop", **SMALL).id
    play(hub)
    every = [one.number for one in here.events(evaluation) if one.number is not None]

    later = [one.number for one in here.events(evaluation, every[3]) if one.number is not None]

    assert later == every[4:]


@pytest.mark.slow
def test_a_server_that_is_killed_and_started_again_is_watched_on(tmp_path: Path) -> None:
    """By one that plays nothing; what it lost would be lost to whoever watches."""
    with RunningServer(tmp_path / "data", "--no-references", workers=0) as server:
        port = server.url.rpartition(":")[2]
        with Client(server.url) as client:
            evaluation = client.evaluate("noop", **SMALL).id
            told: list[Happening] = []
            watching = threading.Thread(target=client.wait, args=[evaluation, told.append])
            watching.start()
            wait_for(lambda: told, "the first event")
            server.kill()
            server.start(port)
            with Client(server.url) as other:
                other.cancel(evaluation)
            watching.join(60)

    assert not watching.is_alive()
    ends = [one.data["state"] for one in told if one.kind == "evaluation"]
    assert ends == ["queued", "cancelled"]


def test_an_upload_goes_on_where_it_was_cut(
    running: tuple[Hub, str], hub: Hub, tmp_path: Path
) -> None:
    file, steps = tmp_path / "weights.safetensors", []
    file.write_bytes(os.urandom(20 * 2**20))

    with cut_way(running[1], 5 * 2**20, 5 * 2**20, 10**9) as way, Client(way.url) as far:
        with pytest.raises(ServerProblem, match="is no checkpoint"):
            far.upload(file, "weights", told=lambda come, _: steps.append(come))
        [left] = [one for one in far.uploads() if one.name == "weights"]

    assert way.cuts >= 2
    assert steps == sorted(steps) and steps[-1] == left.offset == file.stat().st_size
    assert any(come % (8 * 2**20) and come < left.length for come in steps)  # in mid-piece
    assert hub.uploads.of(left.id).path.read_bytes() == file.read_bytes()


def test_another_process_goes_on_with_an_upload(here: Client, tmp_path: Path) -> None:
    file, steps = tmp_path / "weights.safetensors", []
    file.write_bytes(os.urandom(9 * 2**20))

    def killed(come: int, _: int) -> None:
        if come:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        here.upload(file, "killed", told=killed)
    with pytest.raises(ServerProblem, match="is no checkpoint"):
        here.upload(file, "killed", told=lambda come, _: steps.append(come))

    assert steps == [8 * 2**20, 9 * 2**20]


def test_a_file_is_saved_whole_or_not_at_all(
    running: tuple[Hub, str], here: Client, tmp_path: Path
) -> None:
    path, file = "/api/v1/openapi.json", tmp_path / "openapi.json"

    with cut_way(running[1], 20_000) as way, Client(way.url) as far, pytest.raises(Unreachable):
        far.save(path, file)
    left = list(tmp_path.iterdir())
    size = here.save(path, file)

    assert left == [] and list(tmp_path.iterdir()) == [file]
    assert size == file.stat().st_size > 50_000
