"""The client of GR00T's wire, against real ZeroMQ sockets and hostile ones."""

import contextlib
import io
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
import pytest

from hide_tasks.contract import Failure, InvalidAction, PolicyFailure, parse_action
from tests.workers.remote.peers import brief, raw, target
from tests.workers.test_policy_process import observation
from workers.remote import client, egress
from workers.remote.arrays import MAX_MESSAGE, BadMessage
from workers.remote.client import BadServer, PeerError
from workers.remote.gr00t import Gr00tPolicy, pack, unpack
from workers.remote.target import About, process_of
from workers.remote.zmtp import GREETING

SEES = {
    "video": {"front": {"from": "front.rgb", "axes": 2}},
    "state": {"arm": {"from": "joint_positions", "axes": 2}},
    "language": {"task": {"from": "instruction", "axes": 2}},
}
JOINED = {"kind": "joint_position", "join": ["arm", "gripper"], "axes": 1}
MAPS = {"wire": "gr00t", "observation": SEES, "action": JOINED}
ARM = np.arange(21, dtype=np.float32).reshape(1, 3, 7) / 100
GRIPPER = np.full((1, 3, 1), 0.5, np.float32)
ACTIONS = [{"arm": ARM, "gripper": GRIPPER}, {"note": "whatever"}]


class Server:
    """Answers as GR00T's policy server does, and keeps what it was sent."""

    def __init__(self, answer: Any = None):
        self.requests: list[Any] = []
        self.answer = ACTIONS if answer is None else answer

    def __call__(self, request: bytes) -> list[bytes]:
        """The parts of the reply."""
        message = unpack(request)
        self.requests.append(message)
        if message["endpoint"] == "ping":
            return [pack({"status": "ok", "message": "Server is running"})]
        if message["endpoint"] == "reset":
            return [pack({})]
        if isinstance(self.answer, list) and isinstance(self.answer[0], bytes):
            return self.answer
        return [pack(self.answer)]


@contextlib.contextmanager
def serving(answer: Callable[[bytes], list[bytes]], kind: str = "REP") -> Iterator[str]:
    """The address of libzmq's own socket, which answers by what the function gives."""
    zmq = pytest.importorskip("zmq", reason="pyzmq has the real ZeroMQ: pip install pyzmq")
    with zmq.Context() as context, context.socket(getattr(zmq, kind)) as there:
        there.linger = 0
        port = there.bind_to_random_port("tcp://127.0.0.1")
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                if there.poll(20):
                    there.send_multipart(answer(there.recv()))

        thread = threading.Thread(target=serve)
        if kind == "REP":
            thread.start()
        try:
            yield f"tcp://127.0.0.1:{port}"
        finally:
            ended.set()
            if kind == "REP":
                thread.join()


@contextlib.contextmanager
def connected(url: str, key: str | None = None, **changes: Any) -> Iterator[Gr00tPolicy]:
    there = target(url, **MAPS | changes).model_copy(update={"key": key})
    with contextlib.closing(Gr00tPolicy(there)) as policy:
        assert policy.open(0.0) == About(dialect="gr00t", cameras=("front",))
        yield policy


def asked(url: str, **changes: Any) -> Any:
    """The first action of an episode."""
    with connected(url, **changes) as policy:
        policy.reset("wait", 7)
        return policy.act(observation())


# --- what is told, and what is heard ---


def test_a_server_plays_and_is_told_of_episodes_and_of_no_number() -> None:
    server = Server()
    with serving(server) as url, connected(url, key="sesame") as policy:
        for _ in range(2):
            policy.reset("wait", 7)
            action = parse_action(policy.act(observation()))

    assert np.array(action.chunk) == pytest.approx(np.concatenate([ARM[0], GRIPPER[0]], axis=1))
    assert {one["api_token"] for one in server.requests} == {"sesame"}
    calls = [{k: v for k, v in one.items() if k != "api_token"} for one in server.requests]
    begin = [{"endpoint": "ping"}, {"endpoint": "reset", "data": {"options": None}}]
    assert [calls[0], calls[1], calls[3], calls[4]] == begin + begin
    assert set(calls[2]) == {"endpoint", "data"}
    assert set(calls[2]["data"]) == {"observation", "options"}


def test_a_server_sees_what_was_declared_and_nothing_else() -> None:
    server = Server()
    with serving(server) as url:
        asked(url)

    seen = server.requests[-1]["data"]["observation"]
    assert set(seen) == {"video", "state", "language"}
    assert (seen["video"]["front"].shape, seen["video"]["front"].dtype) == ((1, 1, 8, 8, 3), "u1")
    assert (seen["state"]["arm"].shape, seen["state"]["arm"].dtype) == ((1, 1, 7), "f4")
    assert seen["language"] == {"task": [["wait"]]}


def test_it_can_be_told_of_episodes() -> None:
    assert not About(dialect="gr00t").stateless_transport


# --- hostile answers ---


def npy(value: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, value, allow_pickle=True)
    return file.getvalue()


def array(data: object) -> list[bytes]:
    file = {"__ndarray_class__": True, "as_npy": data}
    return [msgpack.packb([{"arm": file, "gripper": file}, {}])]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (array(npy(np.array([object()]))), r"an array of type '\|O'; only plain numbers"),
        (array(npy(np.zeros(1, "f4,f4"))), "an array of type"),
        (array(npy(ARM)[:-1]), "83 bytes are no array"),
        (array(npy(ARM) + b"\0"), "85 bytes are no array"),
        (array(b"\x93NUMPY\x01\x00\xff\xff{}"), "a header of 65535 bytes"),
        (array(b"\x93NUMPY\x03\x00\x02\x00\x00\x00{}"), "version 3"),
        (array(b"\x93NUMPY\x01\x00\x02\x00{}"), "whose header cannot be read"),
        (array(b"\x93NUMPY\x01\x00\x10\x00" + b"(" * 16), "whose header cannot be read"),
        (array(b"\x93NUMPY\x01\x00\x18\x00__import__('os').abort()"), "header cannot be read"),
        (array(b"\x93NUMPY"), "no file of numpy's format"),
        (array("text"), "no file of numpy's format"),
        (array(None), "no file of numpy's format"),
        ([msgpack.packb([{"a": [{}] * 20_000}, {}])], "more than 10000 maps"),
        ([b"\xc1"], "no msgpack"),
        ([b""], "no msgpack"),
        ([bytes(MAX_MESSAGE + 1)], "a frame of 4194305 bytes; at most 4194304"),
        ([b"\x80", b"\x80"], "more than one part"),
        ([msgpack.packb("hello")], "the reply is str; expected two maps"),
        ([msgpack.packb([1, 2])], "the reply is int"),
        ([msgpack.packb([])], "the reply is list"),
        ([{"arm": ARM}, {}], "no 'gripper'; it has arm"),
        ([{"arm": ARM, "gripper": "open"}, {}], "'gripper' is str"),
        ([{"arm": ARM, "gripper": GRIPPER[:, :2]}, {}], r"shape \(1, 3, 7\) and \(1, 2, 1\)"),
        ([{"arm": ARM[0], "gripper": GRIPPER}, {}], r"'arm' has shape \(3, 7\); expected \(1,\)"),
        ([{"arm": ARM, "gripper": GRIPPER[..., 0]}, {}], r"shape \(1, 3, 7\) and \(1, 3\)"),
        ([{"arm": ARM * np.nan, "gripper": GRIPPER}, {}], "holds NaN or infinite"),
    ],
)
def test_an_answer_that_is_none_is_named(answer: Any, message: str) -> None:
    with serving(Server(answer)) as url, pytest.raises(InvalidAction, match=message):
        asked(url)


def test_a_servers_error_is_told_on_one_line_without_escapes() -> None:
    error = pytest.raises(PeerError, match=r"the server says: Traceback .*no cup$")
    with serving(Server({"error": "Traceback\n\x1b[31mno cup"})) as url, error as raised:
        asked(url)

    assert str(raised.value).isprintable()


def test_a_key_that_is_not_the_right_one_is_told() -> None:
    refuses: Callable[[bytes], list[bytes]] = lambda _: [pack({"error": "Unauthorized"})]  # noqa: E731
    with serving(refuses) as url, pytest.raises(BadServer, match="Unauthorized"):
        asked(url)


# --- hostile connections ---


def frame(flags: int, data: bytes) -> bytes:
    return struct.pack(">BQ", flags | 2, len(data)) + data


READY = frame(4, b"\x05READY\x0bSocket-Type\x00\x00\x00\x03REP")
OK = frame(1, b"") + frame(0, pack({"status": "ok"}))


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        (b"", "closed"),
        (b"SSH-2.0-OpenSSH_9.2\r\n" + bytes(64), "speaks no ZeroMQ"),
        (GREETING[:10] + b"\x01" + GREETING[11:], "version 1 of ZMTP; expected 3"),
        (GREETING.replace(b"NULL\0", b"CURVE"), "another security mechanism"),
        (GREETING[:30], "closed"),
        (GREETING + frame(0, b"hello"), "not ready"),
        (GREETING + frame(4, b"\x05ERROR\x03no!"), "not ready"),
        (GREETING + b"\x06" + struct.pack(">Q", 2**60), "a frame of 1152921504606846976 bytes"),
        (GREETING + b"\x80\x00", "unknown flags"),
        (GREETING + frame(4, b"\x05READY\x0bSocket-Type\x00"), "breaks off"),
        (GREETING + frame(4, b"\x05READY\xff"), "breaks off"),
        (GREETING + frame(4, b"\x05READY"), "answers no requests"),
        (GREETING + READY.replace(b"REP", b"PUB"), "answers no requests"),
        (GREETING + READY + frame(0, b""), "no delimiter"),
        (GREETING + READY + frame(1, b"long"), "a frame of 4 bytes"),
        (GREETING + READY + frame(1, b"") + frame(4, b"\x04PING"), "more than one part"),
        (GREETING + READY + OK[:-1], "closed"),
    ],
    ids=brief,
)
def test_what_is_no_such_server_is_refused(sent: bytes, message: str) -> None:
    def handler(connection: socket.socket) -> None:
        connection.sendall(sent)
        connection.settimeout(0.3)
        with contextlib.suppress(OSError):
            while connection.recv(65536):
                pass

    error = pytest.raises(BadServer, match=f"is no such server: .*{message}")
    with raw(handler) as url, error, connected(url.replace("ws:", "tcp:")):
        pass


def test_a_socket_that_answers_no_requests_is_refused() -> None:
    with (
        serving(Server(), kind="PUB") as url,
        pytest.raises(BadServer, match="answers no requests"),
    ):
        asked(url)


def test_a_server_that_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "CONNECT_LIMIT", 0.3)
    silent: Callable[[socket.socket], None] = lambda connection: bool(  # noqa: E731
        connection.recv(65536) and connection.recv(65536)
    )
    error = pytest.raises(BadServer, match=r"nothing came in 0\.3 s")
    with raw(silent) as url, error, connected(url.replace("ws:", "tcp:")):
        pass


def test_only_what_the_operator_allows_is_reached() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0.2)
        there = target(f"tcp://127.0.0.1:{listener.getsockname()[1]}", **MAPS)

        with pytest.raises(egress.Forbidden, match="not encrypted; have the operator allow 127"):
            Gr00tPolicy(there.model_copy(update={"allowed": ()})).open(0.0)

        with pytest.raises(TimeoutError):
            listener.accept()


@pytest.mark.parametrize("how", ["never", "parts", "leaves"])
def test_a_server_that_does_not_answer_an_observation(how: str) -> None:
    """Parts without an end are not gathered."""

    def handler(connection: socket.socket) -> None:
        connection.sendall(GREETING + READY + OK + OK)
        while b"get_action" not in connection.recv(65536):
            pass
        with contextlib.suppress(OSError):
            while how == "parts":
                connection.sendall(frame(1, bytes(1000)))
            if how == "never":
                while connection.recv(65536):
                    pass

    expected = {
        "never": (Failure.POLICY_TIMEOUT, r"act took longer than 0\.5 s"),
        "parts": (Failure.POLICY_INVALID, "a frame of 1000 bytes; at most 0"),
        "leaves": (Failure.POLICY_ERROR, "the server is gone"),
    }
    failure, message = expected[how]
    with raw(handler) as url:
        changed = url.replace("ws:", "tcp:")
        limit = 0.5 if how == "never" else 30.0
        process = process_of(target(changed, **MAPS, timeout=limit, first_timeout=limit))
        process.open()
        process.reset("wait", 7)

        with pytest.raises(PolicyFailure, match=message) as raised:
            process.act(observation())

    assert raised.value.failure is failure


# --- arrays ---


@pytest.mark.parametrize("kind", ["?", "u1", "<i8", ">f4", "f8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_an_array_comes_back_as_it_was(kind: str, order: str) -> None:
    before = np.asarray(np.arange(24).reshape(2, 3, 4).astype(kind), order=order)

    after = unpack(pack({"a": before}))["a"]

    assert (after.dtype, after.shape, after.tolist()) == (kind, before.shape, before.tolist())


@pytest.mark.parametrize("value", [np.array([object()]), object(), 1j, np.zeros(MAX_MESSAGE, "u1")])
def test_what_cannot_be_read_is_not_sent(value: object) -> None:
    with pytest.raises(BadMessage):
        pack({"a": value})
