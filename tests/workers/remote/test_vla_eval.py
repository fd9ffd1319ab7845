"""The client of vla-evaluation-harness's wire, against its own model server and hostile ones."""

import contextlib
import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import msgpack
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

from hide_tasks.contract import Failure, InvalidAction, PolicyFailure, parse_action
from tests.workers.remote.peers import brief, target, websocket
from tests.workers.test_policy_process import observation
from workers.remote.arrays import MAX_MESSAGE
from workers.remote.client import BadServer, PeerError
from workers.remote.target import About, process_of
from workers.remote.vla_eval import VlaEvalPolicy, pack, unpack

VLA_EVAL = os.environ.get("HIDE_VLA_EVAL_PYTHON", "")
HOW = (
    "wants vla-eval in an environment of its own: python3.11 -m venv /tmp/vla-eval; "
    "/tmp/vla-eval/bin/pip install vla-eval; HIDE_VLA_EVAL_PYTHON=/tmp/vla-eval/bin/python"
)
SEES = {
    "images": {"agentview": {"from": "front.rgb"}},
    "state": {"from": ["joint_positions", "gripper_opening"]},
    "task_description": {"from": "instruction"},
}
DELTAS = {"kind": "ee_delta"}
ROW = np.array([0.01, 0.0, -0.02, 0.0, 0.0, 0.1, 1.0], np.float32)


def maps(**changes: Any) -> dict[str, Any]:
    return {"wire": "vla_eval", "observation": SEES, "action": DELTAS, **changes}


class ModelServer:
    """Answers as vla-eval's model servers do, and keeps what it was sent."""

    def __init__(self, answer: Any = None, **hello: Any):
        self.messages: list[dict[Any, Any]] = []
        self.answer = {"actions": ROW} if answer is None else answer
        self.hello = {"protocol_version": 1, "model_server": "Small", **hello}

    def __call__(self, connection: ServerConnection) -> None:
        for frame in connection:
            message = unpack(frame)
            self.messages.append(message)
            if message["type"] == "hello":
                self.send(connection, "hello", self.hello, message["seq"])
            if message["type"] == "observation":
                self.reply(connection, message)

    def reply(self, connection: ServerConnection, message: dict[Any, Any]) -> None:
        if isinstance(self.answer, bytes | str):
            connection.send(self.answer)
        else:
            self.send(connection, "action", self.answer, message["seq"])

    def send(self, connection: ServerConnection, kind: str, payload: Any, seq: int) -> None:
        sent = msgpack.unpackb(pack(kind, payload)[1])
        connection.send(msgpack.packb({**sent, "seq": seq, "timestamp": time.time()}))


def asked(server: Callable[[ServerConnection], None], **changes: Any) -> Any:
    """The first action of an episode."""
    with websocket(server, max_size=None) as url, connected(url, **changes) as policy:
        policy.reset("wait", 7)
        return policy.act(observation())


@contextlib.contextmanager
def connected(url: str, **changes: Any) -> Iterator[VlaEvalPolicy]:
    with contextlib.closing(VlaEvalPolicy(target(url, **maps(**changes)))) as policy:
        policy.open(0.0)
        yield policy


# --- what is told, and what is heard ---


def test_a_model_server_plays_and_is_told_of_episodes_and_of_no_number() -> None:
    server = ModelServer()
    with websocket(server) as url, connected(url, concurrency=3) as policy:
        assert policy.open() == About(
            dialect="vla_eval", model="Small", sessions=3, cameras=("front",)
        )
        for _ in range(2):
            policy.reset("wait", 7)
            actions = [parse_action(policy.act(observation())) for _ in range(2)]

    assert np.array(actions[0].chunk) == pytest.approx(ROW[None])
    kinds = [one["type"] for one in server.messages]
    episode = ["hello", "episode_start", "observation", "observation"]
    assert kinds == ["hello", *episode, *episode]
    assert {one["timestamp"] for one in server.messages} == {0.0}
    seqs = [one["seq"] for one in server.messages]
    assert len(set(seqs)) == len(seqs)
    assert seqs != sorted(seqs)
    assert [one["payload"] for one in server.messages if one["type"] == "episode_start"] == [
        {"task": {"name": "wait"}}
    ] * 2


def test_a_model_server_sees_what_was_declared_and_nothing_else() -> None:
    server = ModelServer()
    asked(server)

    seen = server.messages[-1]["payload"]
    assert set(seen) == {"images", "state", "task_description"}
    assert seen["images"]["agentview"].shape == (8, 8, 3)
    assert seen["state"].tolist() == [0.0] * 7 + [1.0]
    assert seen["task_description"] == "wait"


def test_a_chunk_is_carried_out_as_declared() -> None:
    server = ModelServer({"actions": np.tile(ROW, (8, 1))})

    assert len(asked(server, action={**DELTAS, "rows": 8, "execute": 5}).chunk) == 5


# --- what does not fit ---


def says(frame: str | bytes) -> Callable[[ServerConnection], None]:
    """A server that answers hello with this, and then waits."""

    def handler(connection: ServerConnection) -> None:
        connection.recv()
        connection.send(frame)
        with contextlib.suppress(ConnectionClosed):
            connection.recv()

    return handler


def leaves(connection: ServerConnection) -> None:
    connection.recv()
    connection.close(1011, "out of memory")


@pytest.mark.parametrize(
    ("server", "message"),
    [
        (ModelServer(protocol_version=2), "speaks protocol 2 of vla-eval; expected 1"),
        (
            ModelServer(action_spec={"position": {"dims": 3}, "rotation": {"dims": 3}}),
            "its actions have 6 columns; ee_delta was declared, which has 7",
        ),
        (says(b"\xc1"), "no msgpack"),
        (says(pack("action", {})[1]), "answers hello with 'action'"),
        (says(msgpack.packb({"type": "hello"})), "no type or no payload"),
        (says(msgpack.packb([1])), "the message is list"),
        (says("go away"), "the server says: go away"),
        (says(bytes(MAX_MESSAGE + 1)), "no such server: .*1009"),
        (leaves, "1011.*out of memory"),
    ],
)
def test_a_server_that_does_not_fit_is_found_out_at_once(server, message: str) -> None:
    error = pytest.raises(BadServer, match=message)
    with websocket(server) as url, error, connected(url):
        pass


def test_a_server_that_says_how_its_actions_are_may_fit() -> None:
    spec = {"position": {"dims": 3}, "rotation": {"dims": 3}, "gripper": {"dims": 1}}

    assert asked(ModelServer(action_spec=spec))


# --- hostile answers ---


def array(dtype: object, shape: object = (7,), data: object = bytes(28)) -> bytes:
    fields = {"__ndarray__": True, "dtype": dtype, "shape": shape, "data": data}
    return message("action", {"actions": fields})


def message(kind: object, payload: object, **more: object) -> bytes:
    return msgpack.packb({"type": kind, "payload": payload, "seq": 1, "timestamp": 0.0, **more})


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (array("O"), "an array of type 'O'; only plain numbers"),
        (array("V4"), "an array of type 'V4'"),
        (array("<f4", (8,)), "28 bytes are no array"),
        (array("<f4", (2**40, 2**40)), "an array of shape"),
        (message("action", {"actions": {"__image__": True, "data": b"x"}}), "an encoded image"),
        (message("action", {"a": [{}] * 20_000}), "more than 10000 maps"),
        (message("action", [1]), "no type or no payload"),
        (message(7, {}), "no type or no payload"),
        (message("episode_end", {}), "the reply is 'episode_end', no action"),
        (message("action", {}), "reply is to another request"),
        (message("action", {}, seq=None), "reply is to another request"),
        (b"\xc1", "no msgpack"),
        (b"", "no msgpack"),
        (bytes(MAX_MESSAGE + 1), "1009"),
        ({}, "no 'actions'; it has nothing"),
        ({"actions": "left"}, "'actions' is str"),
        ({"actions": ROW[:6]}, r"shape \(6,\); expected \(1 to 200, 7\)"),
        ({"actions": np.zeros((201, 7))}, r"shape \(201, 7\)"),
        ({"actions": np.zeros((1, 1, 7))}, r"shape \(1, 1, 7\)"),
        ({"actions": ROW * np.nan}, "holds NaN or infinite"),
        ({"actions": np.full(7, np.inf)}, "holds NaN or infinite"),
    ],
    ids=brief,
)
def test_an_answer_that_is_none_is_named(answer, words: str) -> None:
    with pytest.raises(InvalidAction, match=words):
        asked(ModelServer(answer))


@pytest.mark.parametrize(
    "answer", ["Traceback\n\x1b[31mno cup", message("error", {"error": "no cup"})]
)
def test_a_servers_error_is_its_failure(answer: str | bytes) -> None:
    with pytest.raises(PeerError, match=r"the server says: .*no cup$"):
        asked(ModelServer(answer))


def test_an_episode_that_could_not_begin_has_failed() -> None:
    class NoEpisode(ModelServer):
        def __call__(self, connection: ServerConnection) -> None:
            hello = unpack(connection.recv())
            self.send(connection, "hello", self.hello, hello["seq"])
            start = unpack(connection.recv())
            self.send(connection, "error", {"error": "episode_start_failed"}, start["seq"])
            connection.recv()

    with pytest.raises(PeerError, match="episode_start_failed"):
        asked(NoEpisode())


def test_a_server_that_leaves_has_failed() -> None:
    class Leaves(ModelServer):
        def reply(self, connection: ServerConnection, message: dict[Any, Any]) -> None:
            connection.close(1011, "out of memory")

    with pytest.raises(PeerError, match=r"1011.*out of memory"):
        asked(Leaves())


def test_a_server_that_never_answers_is_late() -> None:
    class Waits(ModelServer):
        def reply(self, connection: ServerConnection, message: dict[Any, Any]) -> None:
            with contextlib.suppress(Exception):
                connection.recv()

    with websocket(Waits()) as url:
        process = process_of(target(url, **maps(timeout=0.5, first_timeout=0.5)))
        process.open()
        process.reset("wait", 7)

        with pytest.raises(PolicyFailure, match=r"act took longer than 0\.5 s") as raised:
            process.act(observation())

    assert raised.value.failure is Failure.POLICY_TIMEOUT


# --- vla-eval's own model server ---


@contextlib.contextmanager
def model_server(port: int) -> Iterator[str]:
    """The address of a small model behind vla-eval's own server."""
    peer = Path(__file__).with_name("vla_eval_peer.py")
    with subprocess.Popen([VLA_EVAL, "-I", str(peer), str(port)]) as process:
        try:
            _require_well(f"http://127.0.0.1:{port}/health")
            yield f"ws://127.0.0.1:{port}"
        finally:
            process.terminate()


def _require_well(url: str, within: float = 120.0) -> None:
    end = time.monotonic() + within
    while True:
        try:
            assert httpx.get(url, trust_env=False).status_code == 200
            return
        except httpx.TransportError:
            assert time.monotonic() < end, f"{url} does not answer"
            time.sleep(0.2)


@pytest.mark.skipif(not VLA_EVAL, reason=HOW)
def test_vla_evals_own_model_server_plays() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with model_server(port) as url, connected(url) as policy:
        assert policy.open() == About(
            dialect="vla_eval", model="Counts", sessions=1, cameras=("front",)
        )
        heights = []
        for _ in range(2):
            policy.reset("wait", 7)
            heights.append([policy.act(observation()).chunk[0][2] for _ in range(3)])
        policy.reset("fail", 7)
        with pytest.raises(PeerError, match="RuntimeError: no cup"):
            policy.act(observation())

    # Its model counts the observations of an episode.
    assert heights == [pytest.approx([0.0, 0.01, 0.02])] * 2
