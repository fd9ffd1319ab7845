"""Our own policies, served: to our own client, to openpi's, and to clients that misbehave."""

import json
import os
import re
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hide_tasks.contract import Belief, Keyframe, PolicyFailure, parse_action
from tests.workers.remote.test_maps import observation
from tests.workers.test_policy_process import POLICIES
from workers.policies import Hosted, Surroundings
from workers.protocol import RemotePolicy
from workers.remote import arrays, seats, serving
from workers.remote.client import BadServer, PeerError
from workers.remote.maps import Declaration, everything
from workers.remote.observations import told
from workers.remote.openpi import OpenpiPolicy
from workers.remote.serving import PolicyServer
from workers.remote.target import Target

OPENPI = os.environ.get("HIDE_OPENPI_PYTHON", "")
HOW = (
    "openpi-client needs numpy 1, so it wants an environment of its own: python3.11 -m venv "
    "/tmp/openpi; /tmp/openpi/bin/pip install openpi-client typing_extensions; HIDE_OPENPI_PYTHON="
    "/tmp/openpi/bin/python"
)


@contextmanager
def served(name: str = "Stays", **settings: object) -> Iterator[str]:
    """The address of a server that plays one of the policies of the tests."""
    policy = Hosted(f"{POLICIES}:{name}", Surroundings(timeout=20.0))
    server = PolicyServer(policy, model=name, **settings)
    listening = server.listen("127.0.0.1", 0)
    thread = threading.Thread(target=listening.serve_forever)
    thread.start()
    try:
        yield f"ws://127.0.0.1:{listening.socket.getsockname()[1]}"
    finally:
        server.close()
        listening.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def stays() -> Iterator[str]:
    """A server for one session at a time."""
    with served() as url:
        yield url


def client(url: str, key: str | None = None) -> OpenpiPolicy:
    policy = RemotePolicy(url=url)
    return OpenpiPolicy(Target(policy=policy, allowed=("127.0.0.1",), key=key))


def test_a_served_policy_plays_as_it_does_here() -> None:
    with served(sessions=2) as url, closing(client(url)) as policy:
        about = policy.open()
        assert (about.dialect, about.model, about.sessions) == ("hide", "Stays", 2)
        for _ in range(2):
            policy.reset("wait", 7)
            actions = [parse_action(policy.act(observation())) for _ in range(2)]

            assert actions == [Keyframe.at(observation().gripper_pose, opening=0.0)] * 2
            assert Belief.model_validate(policy.belief()) == Belief(stage_count=2)


def test_sessions_share_nothing() -> None:
    with served(sessions=2) as url, closing(client(url)) as one, closing(client(url)) as other:
        for policy in (one, other):
            policy.open()
            policy.reset("wait", 7)
        counts = []
        for policy in (one, other, one, one, other):
            policy.act(observation())
            counts.append(policy.belief()["stage_count"])

    assert counts == [1, 1, 2, 3, 2]


def test_a_session_too_many_is_sent_away_and_comes_when_there_is_room(
    stays: str, monkeypatch
) -> None:
    monkeypatch.setattr(seats, "SEAT_LIMIT", 0.2)
    with closing(client(stays)) as one, closing(client(stays)) as other:
        one.open()
        with pytest.raises(BadServer, match=r"1013.*all sessions are taken"):
            other.open()

        one.close()
        monkeypatch.undo()

        assert other.open().model == "Stays"


def test_what_a_policy_raises_is_told_and_the_next_episode_begins_afresh() -> None:
    with served("Raises") as url, closing(client(url)) as policy:
        for _ in range(2):
            policy.reset("wait", 7)
            with pytest.raises(PeerError, match="RuntimeError: no such thing as a cup"):
                policy.act(observation())


def test_a_policy_that_cannot_be_loaded_is_not_served() -> None:
    with pytest.raises(PolicyFailure, match="has no class Nobody"):
        PolicyServer(Hosted(f"{POLICIES}:Nobody"), sessions=2)


def test_only_who_has_the_key_is_let_in() -> None:
    with served(key="sesame") as url:
        for wrong in (None, "", "sesam", "sesame1"):
            with pytest.raises(BadServer, match="HTTP status 401"):
                client(url, wrong).open()

        with closing(client(url, "sesame")) as right:
            assert right.open().model == "Stays"


def test_whether_it_is_well_is_told_over_http() -> None:
    with served(key="sesame") as url:
        answer = httpx.get(f"{url.replace('ws:', 'http:')}/healthz", trust_env=False)

    assert (answer.status_code, answer.text) == (200, "OK\n")


def test_a_page_in_a_browser_is_refused(stays: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        connect(stays, origin="https://evil.example", proxy=None).__enter__()


# --- clients that misbehave ---

NOTHING = {"endpoint": "reset", "session_id": "s", "instruction": "wait"}
HUGE = np.zeros((900, 1025, 3), np.uint8)


def message(**changes: object) -> dict[str, object]:
    return {**told(observation(), everything()), **changes}


@pytest.mark.parametrize(
    ("messages", "error"),
    [
        ([b"\xc1"], "no msgpack"),
        (["hello"], "a text; expected a binary frame"),
        ([{"endpoint": "shutdown"}], "no endpoint 'shutdown'; there are reset and infer"),
        ([{"endpoint": "reset"}], "session_id is missing"),
        ([{**NOTHING, "instruction": 5}], "instruction is int"),
        ([message(endpoint="infer", session_id="s")], "send endpoint reset first"),
        ([NOTHING, message(endpoint="infer", session_id="t")], "send endpoint reset first"),
        ([{}], "instruction is missing"),
        ([{"instruction": "wait"}], "front/rgb is missing"),
        ([message(**{"front/rgb": HUGE})], "front/rgb is uint8 .* expected"),
        ([NOTHING, message(endpoint="infer", session_id="s", request_id="x" * 200)], "request_id"),
    ],
)
def test_a_message_that_is_none_of_ours_ends_the_session_with_its_reason(
    stays: str, messages, error
) -> None:
    with connect(stays, compression=None, proxy=None) as connection:
        assert Declaration.model_validate(arrays.unpack(connection.recv())["hide"])
        for one in messages:
            connection.send(one if isinstance(one, bytes | str) else arrays.pack(one))
        replies = [connection.recv() for _ in messages]
        with pytest.raises(ConnectionClosed, match="1011"):
            connection.recv()

    assert re.search(error, replies[-1])


def test_a_message_that_is_too_large_is_not_read(stays: str) -> None:
    with connect(stays, compression=None, proxy=None) as connection:
        connection.recv()
        connection.send(bytes(arrays.MAX_MESSAGE + 1))

        with pytest.raises(ConnectionClosed, match="1009"):
            connection.recv()


def test_a_client_that_vanishes_leaves_its_place(stays: str) -> None:
    for _ in range(3):
        policy = client(stays)
        policy.reset("wait", 7)
        connection = policy._there._socket.socket
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        connection.shutdown(socket.SHUT_RDWR)
        connection.close()

    with closing(client(stays)) as policy:
        policy.reset("wait", 7)
        assert parse_action(policy.act(observation()))


def test_a_session_in_which_nothing_comes_is_over(stays: str, monkeypatch) -> None:
    monkeypatch.setattr(serving, "IDLE_LIMIT", 0.2)
    with connect(stays, compression=None, proxy=None) as connection:
        connection.recv()

        with pytest.raises(ConnectionClosed, match=r"1013.*idle"):
            connection.recv(timeout=10)


def test_the_server_ends_while_a_policy_is_thinking() -> None:
    with served("Hangs") as url:
        policy = client(url)
        policy.reset("wait", 7)
        failed: list[Exception] = []

        def ask() -> None:
            try:
                policy.act(observation())
            except Exception as error:
                failed.append(error)

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(0.3)
        began = time.monotonic()
    asking.join(10)

    assert time.monotonic() - began < 10
    assert isinstance(failed[0], PeerError)


def test_a_policy_thinks_no_longer_than_its_client_waits() -> None:
    with served("Hangs") as url:
        policy = client(url)
        policy.reset("wait", 7)
        message = told(observation(), everything()) | {"endpoint": "infer"}
        policy._there._socket.send(arrays.pack(message | {"session_id": policy._session}))
        policy.close()

        with closing(client(url)) as other:
            assert other.open().model == "Hangs"


# --- openpi's own client ---


@pytest.mark.skipif(not OPENPI, reason=HOW)
def test_openpis_own_client_plays_with_a_served_policy() -> None:
    peer = Path(__file__).with_name("openpi_client_peer.py")
    with served(key="sesame") as url:
        ended = subprocess.run(
            [OPENPI, "-I", str(peer), url, "sesame"], capture_output=True, text=True, timeout=60
        )

    assert ended.returncode == 0, ended.stderr
    told_us = json.loads(ended.stdout)
    assert Declaration.model_validate(told_us["metadata"]["hide"]).model == "Stays"
    actions = [parse_action(reply["action"]) for reply in told_us["replies"]]
    pose = np.array([0.2, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert actions == [Keyframe.at(pose, opening=0.0)] * 2
    assert [reply["belief"]["stage_count"] for reply in told_us["replies"]] == [1, 2]
    assert "front/rgb is missing" in told_us["error"]
