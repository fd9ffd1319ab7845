"""The client of OpenVLA's wire, against a server with its own json-numpy and hostile ones."""

import contextlib
import json
import os
import re
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hide_tasks.contract import Failure, InvalidAction, PolicyFailure, parse_action
from tests.workers.remote.peers import brief, raw, target
from tests.workers.test_policy_process import observation
from workers.remote import client, egress, json_arrays
from workers.remote.act import ActPolicy
from workers.remote.arrays import MAX_MESSAGE, BadMessage
from workers.remote.client import BadServer, PeerError
from workers.remote.target import About, process_of

JSON_NUMPY = os.environ.get("HIDE_JSON_NUMPY_PYTHON", "")
HOW = (
    "wants json-numpy in an environment of its own: python3.11 -m venv /tmp/json-numpy; "
    "/tmp/json-numpy/bin/pip install json-numpy; HIDE_JSON_NUMPY_PYTHON=/tmp/json-numpy/bin/python"
)
SEES = {
    "image": {"from": "front.rgb"},
    "instruction": {"from": "instruction"},
    "unnorm_key": {"value": "bridge_orig"},
}
MAPS = {"wire": "act", "observation": SEES, "action": {"kind": "ee_delta"}}
ROW = [0.01, 0.0, -0.02, 0.0, 0.0, 0.1, 1.0]


@contextlib.contextmanager
def answering(reply: Any, kept: list[Any] | None = None, status: int = 200) -> Iterator[str]:
    """The address of a server that answers every POST with this; bytes are sent as they are."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if kept is not None:
                kept.append((self.path, dict(self.headers), json_arrays.unpack(body)))
            data = reply if isinstance(reply, bytes) else json_arrays.pack(reply)
            self.send_response(status)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def handle(self) -> None:
            with contextlib.suppress(ConnectionError):
                super().handle()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def asked(url: str, key: str | None = None, **changes: Any) -> Any:
    """The first action of an episode."""
    there = target(url, **MAPS | changes).model_copy(update={"key": key})
    policy = ActPolicy(there)
    assert policy.open(0.0) == About(dialect="act", cameras=("front",))
    policy.reset("wait", 7)
    return policy.act(observation())


# --- what is told, and what is heard ---


def test_a_server_sees_what_was_declared_and_nothing_else() -> None:
    kept: list[Any] = []
    with answering(np.array(ROW), kept) as url:
        action = parse_action(asked(url, key="sesame"))

    assert np.array(action.chunk) == pytest.approx(np.array([ROW]))
    [(path, headers, message)] = kept
    assert (path, headers["Authorization"]) == ("/act", "Api-Key sesame")
    assert set(message) == set(SEES)
    assert (message["image"].shape, message["image"].dtype) == ((8, 8, 3), np.uint8)
    assert (message["instruction"], message["unnorm_key"]) == ("wait", "bridge_orig")


def test_a_path_of_its_own_is_kept() -> None:
    kept: list[Any] = []
    with answering(ROW, kept) as url:
        asked(f"{url}/v1/predict?model=7b")

    assert kept[0][0] == "/v1/predict?model=7b"


def test_nothing_tells_of_episodes() -> None:
    assert About(dialect="act").stateless_transport


@pytest.mark.parametrize(
    "reply",
    [
        ROW,
        [ROW, ROW],
        np.array(ROW, np.float32),
        np.array([ROW, ROW]),
        [np.array(ROW), np.array(ROW)],
        {"actions": [ROW, ROW], "time": 0.2},
        {"actions": np.array(ROW)},
    ],
)
def test_rows_are_told_in_many_ways(reply: Any) -> None:
    with answering(reply) as url:
        chunk = asked(url).chunk

    assert np.array(chunk) == pytest.approx(np.array([ROW] * len(chunk)))


def test_an_action_of_our_own_form() -> None:
    keyframe = {
        "kind": "keyframe",
        "position": [0.2, 0, 1],
        "quaternion": [0, 0, 0, 1],
        "opening": 1,
    }
    with answering({"action": keyframe}) as url:
        assert parse_action(asked(url, action={"kind": "action"})).kind == "keyframe"


# --- hostile answers ---


def array(dtype: object, shape: object = (7,), data: object = "AAAA" * 19) -> bytes:
    return json.dumps({"__numpy__": data, "dtype": dtype, "shape": shape}).encode()


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (array("|O"), r"an array of type '\|O'; only plain numbers"),
        (array([["a", "<f4"]]), "an array of type"),
        (array("<f8"), "57 bytes are no array"),
        (array("<f4", (2**40, 2**40)), "an array of shape"),
        (array("<f4", None), "an array of shape None"),
        (array("<f4", data="no base64"), "no base64"),
        (array("<f4", data=5), "no base64"),
        (b"", "no JSON"),
        (b"<html>", "no JSON"),
        (b"\xff\xfe\x00", "no JSON"),
        (b"[" * 100_000, "no JSON"),
        (b"1" * 10_000, "no JSON"),
        (b'{"a":[' + b"{}," * 20_000 + b"{}]}", "more than 10000 maps"),
        (b" " * (MAX_MESSAGE + 1), "more than 4194304 bytes"),
        (b"{}", "no 'actions'; it has nothing"),
        (b"null", "'actions' is NoneType"),
        (b"[]", "'actions' is list"),
        (b"[[1, 2], [3]]", "'actions' is list"),
        (b"[" * 500 + b"1" + b"]" * 500, "'actions' is list"),
        (b'["left"]', "'actions' is list"),
        (b"[true, true, true, true, true, true, true]", "'actions' is list"),
        (ROW[:6], r"shape \(6,\); expected \(1 to 200, 7\)"),
        ([[ROW]], r"shape \(1, 1, 7\)"),
        (np.zeros((201, 7)), r"shape \(201, 7\)"),
        (b"[NaN, 0, 0, 0, 0, 0, 0]", "holds NaN or infinite"),
        (b"[1e999, 0, 0, 0, 0, 0, 0]", "holds NaN or infinite"),
        (b"[1" + b"0" * 400 + b", 0, 0, 0, 0, 0, 0]", "'actions' is list"),
    ],
    ids=brief,
)
def test_an_answer_that_is_none_is_named(reply: Any, message: str) -> None:
    with answering(reply) as url, pytest.raises(InvalidAction, match=message):
        asked(url)


def test_openvlas_error_is_its_failure() -> None:
    with answering("error") as url, pytest.raises(PeerError, match="the server says: error"):
        asked(url)


def test_a_status_is_told_on_one_line_without_escapes() -> None:
    text = b"Traceback\n\x1b[31mno cup"
    error = pytest.raises(PeerError, match=r"HTTP status 500: Traceback .*no cup$")
    with answering(text, status=500) as url, error as raised:
        asked(url)

    assert str(raised.value).isprintable()


# --- hostile connections ---


def sends(answer: bytes) -> Callable[[socket.socket], None]:
    """Answers the first request by this, whatever it is, and closes."""

    def handler(connection: socket.socket) -> None:
        read_whole(connection)
        connection.sendall(answer)

    return handler


def read_whole(connection: socket.socket) -> None:
    """Reads a request to its end: closed before, the connection is reset and its answer lost."""
    found = b""
    while piece := connection.recv(2**20):
        found += piece
        head, end, body = found.partition(b"\r\n\r\n")
        length = re.search(rb"(?i)content-length: (\d+)", head)
        if end and len(body) >= int(length[1] if length else 0):
            return


@contextlib.contextmanager
def second(handler: Callable[[socket.socket], None]) -> Iterator[str]:
    """The address of a server that closes its first connection, and does this with the second.

    The first one only looks whether the server is there.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(30)

        def accept() -> None:
            with contextlib.suppress(OSError):
                listener.accept()[0].close()
                with listener.accept()[0] as connection:
                    connection.settimeout(None)
                    handler(connection)

        thread = threading.Thread(target=accept)
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            thread.join()


HEAD = b"HTTP/1.1 200 OK\r\n"


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (b"", PeerError, "gave no answer"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", PeerError, "gave no answer"),
        (HEAD + b"X-A: b\r\n" * 200 + b"\r\n", PeerError, "gave no answer"),
        (HEAD + b"X-A: " + b"b" * 70_000 + b"\r\n\r\n", PeerError, "gave no answer"),
        (HEAD + b"Content-Length: 50\r\n\r\n[1,", PeerError, "broke off 47 bytes before"),
        (HEAD + b"Transfer-Encoding: chunked\r\n\r\n5\r\n[1", PeerError, "gave no answer"),
        (HEAD + b"Content-Length: -5\r\n\r\n[1,", InvalidAction, "no JSON"),
        (HEAD + b"\r\n[1,", InvalidAction, "no JSON"),
        (b"HTTP/1.1 401 Unauthorized\r\n\r\nno key", PeerError, "HTTP status 401: no key"),
        (b"HTTP/1.1 204 No Content\r\n\r\n", PeerError, "HTTP status 204"),
    ],
    ids=brief,
)
def test_what_is_no_answer_is_named(answer: bytes, error: type[Exception], message: str) -> None:
    with second(sends(answer)) as url, pytest.raises(error, match=message):
        asked(url)


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_no_redirect_is_followed(status: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as metadata_service:
        metadata_service.settimeout(0.2)
        place = f"http://127.0.0.1:{metadata_service.getsockname()[1]}/latest/meta-data"
        answer = f"HTTP/1.1 {status} Moved\r\nLocation: {place}\r\nContent-Length: 0\r\n\r\n"
        error = pytest.raises(PeerError, match=f"{status}; redirects are not followed")
        with second(sends(answer.encode())) as url, error:
            asked(url)

        with pytest.raises(TimeoutError):
            metadata_service.accept()


def test_no_proxy_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
        monkeypatch.setenv(name.upper(), "http://127.0.0.1:9")
    monkeypatch.setenv("no_proxy", "")

    with answering(ROW) as url:
        assert asked(url)


def test_a_private_address_is_not_connected_to_unless_allowed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0.2)
        there = target(f"https://127.0.0.1:{listener.getsockname()[1]}", **MAPS)

        with pytest.raises(egress.Forbidden, match="not a public address"):
            ActPolicy(there.model_copy(update={"allowed": ()})).open(0.0)

        with pytest.raises(TimeoutError):
            listener.accept()


def test_a_server_without_the_right_certificate_is_refused() -> None:
    with answering(ROW) as url, pytest.raises(BadServer, match=r"(?i)ssl|tls"):
        ActPolicy(target(url.replace("http:", "https:"), **MAPS)).open(0.0)


def test_a_server_that_speaks_no_tls_in_time_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "CONNECT_LIMIT", 0.3)
    silent: Callable[[socket.socket], None] = lambda connection: bool(  # noqa: E731
        connection.recv(65536) and connection.recv(65536)
    )
    with raw(silent) as url, pytest.raises(BadServer, match=r"nothing came in 0\.3 s"):
        ActPolicy(target(url.replace("ws:", "https:"), **MAPS)).open(0.0)


@pytest.mark.parametrize("how", ["never", "drip"])
def test_a_server_that_never_answers_is_late(how: str) -> None:
    def handler(connection: socket.socket) -> None:
        connection.recv(2**20)
        with contextlib.suppress(OSError):
            while how == "drip":
                connection.sendall(b"HTTP/1.1 100 Continue\r\n\r\n")  # for ever
                time.sleep(0.01)
            while connection.recv(2**20):  # the request comes in pieces
                pass

    with second(handler) as url:
        process = process_of(target(url, **MAPS, timeout=0.5, first_timeout=0.5))
        process.open()
        process.reset("wait", 7)

        with pytest.raises(PolicyFailure, match=r"act took longer than 0\.5 s") as raised:
            process.act(observation())

    assert raised.value.failure is Failure.POLICY_TIMEOUT


# --- arrays ---


def test_an_array_comes_back_as_it_was() -> None:
    for kind in ("?", "u1", "<i8", ">f4", "f8"):
        before = np.ones((2, 0, 3), kind), np.array(1, kind), np.arange(4).astype(kind)

        after = json_arrays.unpack(json_arrays.pack(list(before)))

        for one, other in zip(before, after, strict=True):
            assert (one.dtype, one.shape) == (other.dtype, other.shape)
            assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("value", [np.array([object()]), object(), float("nan"), np.zeros(2**23)])
def test_what_cannot_be_read_is_not_sent(value: object) -> None:
    with pytest.raises(BadMessage):
        json_arrays.pack({"a": value})


# --- json-numpy's own codec ---


@pytest.mark.skipif(not JSON_NUMPY, reason=HOW)
def test_a_server_with_json_numpy_plays() -> None:
    peer = Path(__file__).with_name("json_numpy_peer.py")
    command = [JSON_NUMPY, "-I", str(peer)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = process.stdout.readline().strip()
            single = asked(f"{url}/act")
            chunk = asked(f"{url}/oft")
            with pytest.raises(PeerError, match="the server says: error"):
                asked(f"{url}/act", observation={"instruction": {"from": "instruction"}})
        finally:
            process.terminate()

    # Its model moves by the mean of the picture, which is 0, and turns by the prompt's length.
    assert np.array(single.chunk) == pytest.approx(np.array([[0, 0, 0, 0, 0, 0.4, 1]]))
    assert np.array(chunk.chunk) == pytest.approx(np.array([[0, 0, 0, 0, 0, 0.4, 1]] * 8))
