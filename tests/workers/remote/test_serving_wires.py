"""Our own policies served over the wires of others: to our clients, and to what is no client."""

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.sync.client import connect

from hide_tasks.contract import Keyframe, parse_action
from tests.workers.remote.test_maps import observation
from tests.workers.test_policy_process import POLICIES
from workers.policies import Hosted, Remote, Surroundings, parse
from workers.remote import gr00t, json_arrays, vla_eval
from workers.remote.arrays import MAX_MESSAGE
from workers.remote.client import BadServer, Client, PeerError
from workers.remote.maps import ActionMap, as_toml, everything
from workers.remote.observations import told
from workers.remote.serving_act import ActServer
from workers.remote.serving_gr00t import Gr00tServer
from workers.remote.serving_vla_eval import VlaEvalServer
from workers.remote.target import Target
from workers.remote.wires import SCHEMES

SERVERS: dict[str, Any] = {"vla_eval": VlaEvalServer, "act": ActServer, "gr00t": Gr00tServer}
CLIENTS: dict[str, type[Client]] = {
    "vla_eval": vla_eval.VlaEvalPolicy,
    "gr00t": gr00t.Gr00tPolicy,
}
every_wire = pytest.mark.parametrize("wire", SERVERS)


@contextmanager
def served(wire: str, name: str = "Stays", **settings: Any) -> Iterator[str]:
    """The address of a server that plays one of the policies of the tests."""
    if wire == "gr00t":
        pytest.importorskip("zmq", reason="pyzmq has the real ZeroMQ: pip install pyzmq")
    policy = Hosted(f"{POLICIES}:{name}", Surroundings(timeout=20.0))
    server = SERVERS[wire](policy, model=name, **settings)
    listening = server.listen("127.0.0.1", 0)
    thread = threading.Thread(target=listening.serve_forever)
    with listening:
        thread.start()
        port = getattr(listening, "port", 0) or listening.socket.getsockname()[1]
        try:
            yield f"{SCHEMES[wire][0]}://127.0.0.1:{port}"  # type: ignore[index]
        finally:
            server.close()
            listening.shutdown()
            thread.join()


def client(wire: str, url: str, folder: Path, key: str | None = None) -> Client:
    """Our own, from the file that `hide serve-policy --write-maps` writes."""
    from workers.remote.act import ActPolicy

    maps = folder / "maps.toml"
    maps.write_text(as_toml(wire, everything(), ActionMap()))
    found = parse(url, maps=maps)
    assert isinstance(found, Remote)
    target = Target(policy=found.spec, allowed=("127.0.0.1",), key=key)
    return CLIENTS.get(wire, ActPolicy)(target)


@every_wire
def test_a_served_policy_plays_as_it_does_here(wire: str, tmp_path: Path) -> None:
    with served(wire) as url, closing(client(wire, url, tmp_path)) as policy:
        policy.open()
        for _ in range(2):
            policy.reset("wait", 7)
            actions = [parse_action(policy.act(observation())) for _ in range(2)]

            assert actions == [Keyframe.at(observation().gripper_pose, opening=0.0)] * 2


@every_wire
def test_an_episode_begins_afresh_where_the_wire_tells_of_it(wire: str, tmp_path: Path) -> None:
    with served(wire, "Lowers") as url, closing(client(wire, url, tmp_path)) as policy:
        policy.open()
        heights = []
        for _ in range(2):
            policy.reset("wait", 7)
            heights.append([parse_action(policy.act(observation())).position[2] for _ in range(3)])

    assert heights[0] == heights[1]
    steps = np.diff(heights[0])
    assert np.allclose(steps, 0.0 if wire == "act" else -0.01)  # act tells of no episode at all


@every_wire
def test_what_a_policy_raises_is_told(wire: str, tmp_path: Path) -> None:
    with served(wire, "Raises") as url, closing(client(wire, url, tmp_path)) as policy:
        policy.open()
        policy.reset("wait", 7)
        with pytest.raises(PeerError, match="no such thing as a cup"):
            policy.act(observation())


@every_wire
def test_only_who_has_the_key_is_let_in(wire: str, tmp_path: Path) -> None:
    def plays(url: str, key: str | None) -> Any:
        with closing(client(wire, url, tmp_path, key)) as policy:
            policy.open(0.0)
            policy.reset("wait", 7)
            return policy.act(observation())

    with served(wire, key="open sesame") as url:
        assert plays(url, "open sesame")
        for wrong in (None, "open"):
            with pytest.raises((BadServer, PeerError)):
                plays(url, wrong)


def test_gr00ts_wire_has_one_session() -> None:
    with pytest.raises(ValueError, match="tells no sessions apart"):
        Gr00tServer(Hosted(f"{POLICIES}:Stays"), sessions=2)


@pytest.mark.parametrize(
    ("kind", "payload", "words"),
    [
        ("observation", {}, "no episode is under way"),
        ("episode_start", {}, "has no task"),
        ("episode_start", {"task": {"name": 7}}, "name is int"),
        ("dance", {}, "no type 'dance'"),
    ],
)
def test_what_vla_evals_wire_does_not_know_is_named(kind: str, payload: Any, words: str) -> None:
    with served("vla_eval") as url, connect(url) as there:
        there.send(vla_eval.packed(kind, payload, 5))
        reply = vla_eval.unpack(there.recv())

        assert (reply["type"], reply["seq"]) == ("error", 5)
        assert words in reply["payload"]["error"]
        there.send("a text")
        assert "a text" in vla_eval.unpack(there.recv())["payload"]["error"]
        there.send(vla_eval.packed("hello", {}, 6))
        assert vla_eval.unpack(there.recv())["type"] == "hello"


def test_what_acts_wire_does_not_know_is_named() -> None:
    seen = json_arrays.pack(told(observation(), everything()))
    json_type = {"Content-Type": "application/json"}
    with served("act") as url, httpx.Client(base_url=url, headers=json_type) as there:
        found = [
            there.post("/act", content=seen).status_code,
            there.get("/healthz").status_code,
            there.post("/elsewhere", content=seen).status_code,
            there.post("/act", content=b"{}").status_code,
            there.post("/act", content=b"[").status_code,
            there.post("/act", content=seen, headers={"Origin": "http://evil"}).status_code,
            there.post("/act", content=iter([seen])).status_code,
            there.put("/act", content=seen).status_code,
        ]
        with socket.create_connection(("127.0.0.1", there.base_url.port), timeout=20) as raw:
            long = f"POST /act HTTP/1.1\r\nContent-Length: {MAX_MESSAGE + 1}\r\n\r\n"
            raw.sendall(long.encode())
            status = raw.recv(100).split()[1]
        detail = there.post("/act", content=b"{}").json()

    assert found == [200, 200, 404, 400, 400, 403, 411, 501]
    assert status == b"413"
    assert "front/rgb is missing" in detail


def test_what_gr00ts_wire_does_not_know_is_named() -> None:
    zmq = pytest.importorskip("zmq", reason="pyzmq has the real ZeroMQ: pip install pyzmq")
    with served("gr00t") as url, zmq.Context() as context, context.socket(zmq.REQ) as there:
        there.set(zmq.LINGER, 0)
        there.connect(url)
        said = []
        for frame in (b"\xc1", gr00t.pack(7), gr00t.pack({"endpoint": "dance"})):
            there.send(frame)
            said.append(gr00t.unpack(there.recv())["error"])

    assert "expected a map" in said[1]
    assert "no endpoint 'dance'" in said[2]


def test_a_file_of_maps_is_read_back(tmp_path: Path) -> None:
    maps = tmp_path / "maps.toml"
    maps.write_text(as_toml("act", everything(), ActionMap()))

    found = parse("http://h/act", maps=maps)

    assert isinstance(found, Remote)
    assert found.spec.observation == everything()
    assert found.spec.action == ActionMap()
