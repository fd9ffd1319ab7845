"""The client of the openpi wire, against servers that do as they should and servers that do not."""

import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import numpy as np
import pytest

from hide_tasks.contract import Failure, InvalidAction, PolicyFailure, parse_action
from tests.workers.remote.peers import JOINTS, STATE, answering, brief, raw, target, websocket
from tests.workers.test_policy_process import ended, observation, pid
from workers.remote import arrays, client, egress
from workers.remote.client import BadServer, PeerError
from workers.remote.maps import Declaration
from workers.remote.openpi import OpenpiPolicy
from workers.remote.target import Unreachable, process_of

ROWS = np.tile(np.arange(8.0), (3, 1)) / 10  # the opening is 0.7
HIDE = Declaration.model_validate(
    {"model": "mine", "observation": STATE, "action": JOINTS, "max_sessions": 3}
).message()


@contextmanager
def connected(url: str, **changes: Any) -> Iterator[OpenpiPolicy]:
    policy = OpenpiPolicy(target(url, **changes))
    try:
        policy.open(0.0)
        yield policy
    finally:
        policy.close()


def asked(url: str, **changes: Any) -> Any:
    """The first action of an episode."""
    with connected(url, **changes) as policy:
        policy.reset("wait", 7)
        return policy.act(observation())


class Keeps:
    """Answers with rows of joints, and keeps what it was sent."""

    def __init__(self, **reply: Any):
        self.messages: list[dict[Any, Any]] = []
        self.reply = reply

    def __call__(self, message: dict[Any, Any]) -> Any:
        self.messages.append(message)
        if message.get("endpoint") == "reset":
            return {"ok": True}
        echo = {"request_id": message["request_id"]} if "request_id" in message else {}
        return {"actions": ROWS, **echo, **self.reply}


# --- dialects ---


def test_a_stock_server_sees_what_was_declared_and_nothing_else() -> None:
    server = Keeps(server_timing={"infer_ms": 3.0})
    with answering(server, {"whatever": 1}) as url:
        action = parse_action(asked(url))

    assert np.array(action.chunk).tolist() == ROWS.tolist()
    [message] = server.messages
    assert set(message) == set(STATE)
    assert message["prompt"] == "wait"
    assert message["observation/state"].dtype == np.float32
    assert message["observation/state"].tolist() == [0.0] * 7 + [1.0]
    assert message["observation/image"].shape == (8, 8, 3)


def test_our_dialect_is_told_of_episodes_and_of_no_number() -> None:
    server = Keeps(belief={"stage_count": 2})
    with answering(server, HIDE) as url:
        policy = OpenpiPolicy(target(url, observation=None, action=None))
        about = policy.open()
        assert (about.dialect, about.model, about.sessions) == ("hide", "mine", 3)
        assert (about.sees[-1], about.acts) == ("prompt", "joint_position")
        for _ in range(2):
            policy.reset("wait", 7)
            policy.act(observation())
            policy.act(observation())
        assert policy.belief() == {"stage_count": 2}
        policy.close()

    resets, asks = server.messages[::3], server.messages[1:3] + server.messages[4:]
    assert [set(one) for one in resets] == [{"endpoint", "session_id", "instruction"}] * 2
    ours = {"endpoint", "session_id", "request_id", "is_first"}
    assert [set(one) for one in asks] == [{*STATE, *ours}] * 4
    assert [one["is_first"] for one in asks] == [True, False, True, False]
    assert len({one["request_id"] for one in asks}) == 4
    assert len({one["session_id"] for one in resets}) == 2
    opaque = [one[name] for one in asks for name in ("request_id", "session_id")]
    assert all(len(one) == 32 and set(one) <= set("0123456789abcdef") for one in opaque)


def test_roboarenas_dialect_is_reset_by_a_text() -> None:
    server = Keeps()
    answers: Callable[[dict[Any, Any]], Any] = lambda message: (  # noqa: E731
        "reset successful" if message.get("endpoint") == "reset" else server(message)
    )
    with answering(answers, {"needs_session_id": True}) as url:
        asked(url)

    assert set(server.messages[0]) == {*STATE, "endpoint", "session_id"}


def test_every_episode_has_a_connection_of_its_own() -> None:
    connections = []

    def handler(connection) -> None:
        connections.append(connection.remote_address)
        connection.send(arrays.pack({}))
        for _ in connection:
            connection.send(arrays.pack({"actions": ROWS}))

    with websocket(handler) as url, connected(url) as policy:
        for _ in range(3):
            policy.reset("wait", 7)
            policy.act(observation())

    assert len(set(connections)) == 3


def test_an_answer_of_keyframes_is_as_many_decisions_and_none_is_left_for_the_next_episode() -> (
    None
):
    rows = np.tile([0.2, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0], (5, 1))
    rows[:, 0] += np.arange(5) / 100
    server = Keeps(actions=rows)
    with answering(server) as url, connected(url, action={"kind": "keyframe", "execute": 3}) as one:
        one.reset("wait", 7)
        places = [parse_action(one.act(observation())).position[0] for _ in range(4)]
        one.reset("wait", 7)
        again = parse_action(one.act(observation())).position[0]

    assert places == pytest.approx([0.2, 0.21, 0.22, 0.2])
    assert again == pytest.approx(0.2)
    assert len(server.messages) == 3


def test_our_dialect_may_stop() -> None:
    with answering(Keeps(stop=True), HIDE) as url:
        assert parse_action(asked(url, observation=None, action=None)).stop


def test_a_key_is_sent_as_openpi_sends_it() -> None:
    heard = []

    def handler(connection) -> None:
        heard.append(connection.request.headers["Authorization"])
        connection.send(arrays.pack({}))

    with websocket(handler) as url:
        policy = OpenpiPolicy(target(url).model_copy(update={"key": "sesame"}))
        policy.open()
        policy.close()

    assert heard == ["Api-Key sesame"]


# --- what does not fit ---


@pytest.mark.parametrize(
    ("metadata", "changes", "message"),
    [
        (
            {},
            {"observation": None, "action": None},
            "speaks plain openpi, .* declare `observation`",
        ),
        ({}, {"dialect": "hide"}, "speaks openpi, not hide"),
        (HIDE, {"action": {"kind": "keyframe"}}, "declares other maps than were registered"),
        ({"hide": {"protocol": 2}}, {}, "declares what is not understood: hide.protocol"),
        ({"hide": []}, {}, "declares what is not understood"),
        (
            {"hide": {"protocol": 1, "observation": {"is_first": {"from": "front.rgb"}}}},
            {},
            "the names is_first are the protocol's own",
        ),
        (
            {"hide": {"protocol": 1, "observation": {"x": {"from": "hidden_state"}}}},
            {},
            "no source 'hidden_state'",
        ),
    ],
)
def test_a_server_that_does_not_fit_is_found_out_at_once(metadata, changes, message) -> None:
    with answering(Keeps(), metadata) as url, pytest.raises(BadServer, match=message):
        OpenpiPolicy(target(url, **changes)).open(0.0)


# --- hostile answers ---


def array(dtype: str, shape: object = (8,), data: bytes = bytes(64)) -> bytes:
    fields = {b"__ndarray__": True, b"data": data, b"dtype": dtype, b"shape": shape}
    return msgpack.packb({"actions": fields})


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (array("O"), "an array of type 'O'; only plain numbers"),
        (array("V8"), "an array of type 'V8'"),
        (array("<f8", (9,)), "64 bytes are no array"),
        (array("<f8", (2**40, 2**40)), "an array of shape"),
        (b"\xc1", "no msgpack"),
        (b"", "no msgpack"),
        (msgpack.packb([1]), "the message is list"),
        (msgpack.packb({"a": [{}] * 20_000}), "more than 10000 maps"),
        (bytes(arrays.MAX_MESSAGE + 1), "no reply that may be read: .*1009"),
        ({}, "no 'actions'; it has nothing"),
        ({"action": ROWS}, "no 'actions'; it has action"),
        ({"actions": "left"}, "'actions' is str; expected numbers of shape"),
        ({"actions": [[0.0] * 8]}, "'actions' is list"),
        ({"actions": np.zeros((3, 7))}, r"shape \(3, 7\); expected \(1 to 200, 8\)"),
        ({"actions": np.zeros((1, 3, 8))}, r"shape \(1, 3, 8\)"),
        ({"actions": np.zeros((201, 8))}, r"shape \(201, 8\)"),
        ({"actions": np.zeros((0, 8))}, r"shape \(0, 8\)"),
        ({"actions": np.float64(1.0)}, "'actions' is float"),
        ({"actions": np.array(1.0)}, r"shape \(\)"),
        ({"actions": ROWS > 0.3}, "'actions' is array of bool"),
        ({"actions": np.full((1, 8), np.nan)}, "holds NaN or infinite"),
        ({"actions": np.full((1, 8), np.inf, np.float32)}, "holds NaN or infinite"),
    ],
    ids=brief,
)
def test_an_answer_that_is_none_is_named(reply, message: str) -> None:
    with answering(lambda _: reply) as url, pytest.raises(InvalidAction, match=message):
        asked(url)


def test_numbers_beyond_any_robot_are_no_action() -> None:
    far = {"actions": np.full((1, 8), 1e9)}
    error = pytest.raises(InvalidAction, match="less than or equal to 1000")
    with answering(lambda _: far) as url, error:
        asked(url)


@pytest.mark.parametrize(
    "reply", [{"\x1b[31mactions\n": 1}, {"action": {"kind": "\x1b[31mjump\n\u202e"}}]
)
def test_what_a_server_names_is_shown_without_escapes(reply) -> None:
    server = Keeps(**reply)
    greeting = Declaration.model_validate({"observation": STATE}).message()
    with answering(server, greeting) as url, pytest.raises(InvalidAction) as raised:
        asked(url, observation=None, action=None)

    assert str(raised.value).isprintable()


def test_an_answer_to_another_request_is_none() -> None:
    error = pytest.raises(InvalidAction, match="reply is to another request")
    with answering(Keeps(request_id="0" * 32), HIDE) as url, error:
        asked(url, observation=None, action=None)


def test_a_servers_error_is_told_on_one_line_without_escapes() -> None:
    traceback = "Traceback\n" + "x" * 3000 + "\x1b[31m\u202e\nRuntimeError: no cup"
    with answering(lambda _: traceback) as url, pytest.raises(PeerError) as raised:
        asked(url)

    text = str(raised.value)
    assert text.endswith("RuntimeError: no cup")
    assert text.isprintable() and len(text) < 500


def test_a_server_that_leaves_has_failed() -> None:
    def handler(connection) -> None:
        connection.send(arrays.pack({}))
        connection.recv()
        connection.close(1011, "out of memory")

    with websocket(handler) as url, pytest.raises(PeerError, match=r"1011.*out of memory"):
        asked(url)


# --- hostile connections ---


def handshake(connection: socket.socket) -> None:
    """Opens a WebSocket by hand and says what a stock server says."""
    from websockets.http11 import Request
    from websockets.server import ServerProtocol

    protocol = ServerProtocol()
    while not (events := protocol.events_received()):
        protocol.receive_data(connection.recv(65536))
    assert isinstance(events[0], Request)
    protocol.send_response(protocol.accept(events[0]))
    protocol.send_binary(arrays.pack({}))
    for data in protocol.data_to_send():
        connection.sendall(data)


def closes_mid_frame(connection: socket.socket) -> None:
    handshake(connection)
    connection.recv(65536)
    connection.sendall(b"\x82\x7f" + struct.pack(">Q", 5000) + bytes(100))


def breaks_the_protocol(connection: socket.socket) -> None:
    handshake(connection)
    connection.recv(65536)
    connection.sendall(b"\xf2\x05hello")
    connection.recv(65536)


def announces_too_much(connection: socket.socket) -> None:
    handshake(connection)
    connection.recv(65536)
    connection.sendall(b"\x82\x7f" + struct.pack(">Q", 2**50))
    connection.recv(65536)


def splits_too_much(connection: socket.socket) -> None:
    """Sends fragments that are each small."""
    handshake(connection)
    connection.recv(65536)
    for number in range(6):
        header = b"\x02" if number == 0 else b"\x00"
        connection.sendall(header + b"\x7f" + struct.pack(">Q", 2**20) + bytes(2**20))
    connection.recv(65536)


@pytest.mark.parametrize(
    ("handler", "error", "message"),
    [
        (closes_mid_frame, PeerError, "closed the connection"),
        (breaks_the_protocol, InvalidAction, "1002"),
        (announces_too_much, InvalidAction, "1009"),
        (splits_too_much, InvalidAction, "1009"),
    ],
)
def test_a_broken_connection_is_named(handler, error: type[Exception], message: str) -> None:
    with raw(handler) as url, pytest.raises(error, match=message):
        asked(url)


def http(answer: bytes) -> Callable[[socket.socket], None]:
    def handler(connection: socket.socket) -> None:
        connection.recv(65536)
        connection.sendall(answer)

    return handler


@pytest.mark.parametrize(
    ("handler", "message"),
    [
        (http(b"HTTP/1.1 404 Not Found\r\n\r\n"), "HTTP status 404"),
        (http(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi"), "HTTP status 200"),
        (http(b"SSH-2.0-OpenSSH_9.2\r\n"), "is no such server"),
        (http(b"HTTP/1.1 101 Switching\r\n" + b"X-A: b\r\n" * 5000 + b"\r\n"), "is no such server"),
        (lambda _: None, "is no such server"),
    ],
)
def test_what_is_no_websocket_is_no_server(handler, message: str) -> None:
    with raw(handler) as url, pytest.raises(BadServer, match=message):
        OpenpiPolicy(target(url)).open(0.0)


@pytest.mark.parametrize("status", [301, 302, 307, 308])
def test_no_redirect_is_followed(status: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as metadata_service:
        metadata_service.settimeout(0.2)
        place = f"ws://127.0.0.1:{metadata_service.getsockname()[1]}/latest/meta-data"
        answer = f"HTTP/1.1 {status} Moved\r\nLocation: {place}\r\nContent-Length: 0\r\n\r\n"
        with raw(http(answer.encode())) as url, pytest.raises(BadServer, match="redirect"):
            OpenpiPolicy(target(url)).open(0.0)

        with pytest.raises(TimeoutError):
            metadata_service.accept()


def test_no_proxy_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "https_proxy", "all_proxy", "ws_proxy", "socks_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
        monkeypatch.setenv(name.upper(), "http://127.0.0.1:9")
    monkeypatch.setenv("no_proxy", "")

    with answering(Keeps()) as url:
        assert asked(url)


def test_a_server_that_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "CONNECT_LIMIT", 0.3)
    for silent in (
        lambda connection: connection.recv(65536) and connection.recv(65536),  # no handshake
        lambda connection: silent_after_handshake(connection),
    ):
        with raw(silent) as url, pytest.raises(BadServer, match=r"no such server: .*(0\.3|timed)"):
            OpenpiPolicy(target(url)).open(0.0)


def silent_after_handshake(connection: socket.socket) -> None:
    from websockets.server import ServerProtocol

    protocol = ServerProtocol()
    while not (events := protocol.events_received()):
        protocol.receive_data(connection.recv(65536))
    protocol.send_response(protocol.accept(events[0]))
    connection.sendall(b"".join(protocol.data_to_send()))
    connection.recv(65536)


def test_a_private_address_is_not_connected_to_unless_allowed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0.2)
        there = target(f"wss://127.0.0.1:{listener.getsockname()[1]}")

        with pytest.raises(egress.Forbidden, match="not a public address"):
            OpenpiPolicy(there.model_copy(update={"allowed": ()})).open(0.0)

        with pytest.raises(TimeoutError):
            listener.accept()


def test_a_server_without_the_right_certificate_is_refused() -> None:
    with websocket(lambda _: None) as url, pytest.raises(BadServer, match=r"(?i)ssl|tls"):
        OpenpiPolicy(target(url.replace("ws:", "wss:"))).open(0.0)


# --- in its process ---


def test_the_process_of_a_remote_policy_plays() -> None:
    with answering(Keeps(), HIDE) as url:
        process = process_of(target(url, observation=None, action=None))
        try:
            about = process.open()
            process.reset("wait", 7)
            action = parse_action(process.act(observation()))
        finally:
            process.close()

    assert (about.model, about.stateless_transport) == ("mine", False)
    assert len(action.chunk) == 3


@pytest.mark.parametrize("how", ["never", "drip", "deaf"])
def test_a_server_that_never_answers_is_late_and_its_connection_ends(how: str) -> None:
    gone = []

    def handler(connection: socket.socket) -> None:
        handshake(connection)
        if how == "deaf":
            time.sleep(1.5)  # reads nothing
        while True:
            try:
                if how == "drip":
                    connection.sendall(b"\x89\x01x")  # pings, for ever
                    connection.settimeout(0.05)
                if not connection.recv(2**20):
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        gone.append(True)

    with raw(handler) as url:
        process = process_of(target(url, timeout=0.5, first_timeout=0.5))
        process.open()
        process.reset("wait", 7)
        before = pid(process)

        with pytest.raises(PolicyFailure, match=r"act took longer than 0\.5 s") as raised:
            process.act(observation())

        assert raised.value.failure is Failure.POLICY_TIMEOUT
        assert ended(before)
    assert gone


def test_the_first_answer_may_take_longer_than_the_others() -> None:
    waits = iter([0.6, 0.0, 0.6])

    def answer(_: object) -> Any:
        time.sleep(next(waits))
        return {"actions": ROWS}

    with answering(answer) as url:
        process = process_of(target(url, timeout=0.4, first_timeout=5.0))
        process.open()
        process.reset("wait", 7)
        process.act(observation())
        process.act(observation())

        with pytest.raises(PolicyFailure, match=r"took longer than 0\.4 s"):
            process.act(observation())


@pytest.mark.parametrize(
    ("reply", "failure"),
    [
        ({"actions": np.full((1, 8), np.nan)}, Failure.POLICY_INVALID),
        (array("O"), Failure.POLICY_INVALID),
        ("Traceback: no cup", Failure.POLICY_ERROR),
    ],
)
def test_what_goes_wrong_has_its_name(reply, failure: Failure) -> None:
    with answering(lambda _: reply) as url:
        process = process_of(target(url))
        process.open()
        process.reset("wait", 7)

        with pytest.raises(PolicyFailure) as raised:
            process.act(observation())

    assert raised.value.failure is failure


def test_a_server_that_is_not_there_is_no_fault_of_the_policy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        url = f"ws://127.0.0.1:{free.getsockname()[1]}"
    process = process_of(target(url))

    with pytest.raises(Unreachable, match="Connection refused"):
        process.open(patience=0.2)


def test_a_server_that_starts_anew_is_waited_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    program = (
        "import sys, time; from websockets.sync.server import serve\n"
        "from workers.remote import arrays\n"
        "def handler(c): c.send(arrays.pack({})); c.recv()\n"
        f"serve(handler, '127.0.0.1', {port}).serve_forever()"
    )
    server = subprocess.Popen([sys.executable, "-c", program])
    try:
        policy = OpenpiPolicy(target(f"ws://127.0.0.1:{port}"))
        assert policy.open(patience=20.0).dialect == "openpi"
        policy.close()
    finally:
        server.kill()
        server.wait()


def test_a_policys_process_cannot_read_the_keys_of_servers(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HIDE_REMOTE_KEYS", '{"example.org:443": "sesame"}')
    (tmp_path / "spy.py").write_text(
        "import os\n"
        "class Spy:\n"
        "    def reset(self, instruction, policy_seed): pass\n"
        "    def act(self, observation): raise RuntimeError(os.environ.get('HIDE_REMOTE_KEYS'))\n"
    )
    from workers.policy_process import PolicyProcess

    policy = PolicyProcess(f"{tmp_path}/spy.py:Spy", timeout=20.0)
    policy.reset("wait", 7)
    with pytest.raises(PolicyFailure, match="RuntimeError: None"):
        policy.act(observation())
