"""`hide serve-policy`: one of our own policies, for whoever evaluates it from elsewhere."""

import os
import signal
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hide_tasks.contract import PolicyFailure
from server.arguments import BadUsage
from server.settings import LOOPBACK
from workers import policies
from workers.policies import BadPolicy, Checkpoint, Hosted, Remote, Surroundings
from workers.remote.wires import SCHEMES, Wire

KEY = "HIDE_POLICY_KEY"


def serve_policy(
    text: str,
    *,
    host: str,
    port: int,
    sessions: int,
    timeout: float,
    wire: Wire = "openpi",
    maps: Path | None = None,
    serving: Callable[[str], object],
) -> None:
    """Serves until SIGINT or SIGTERM.

    Args:
        text: POLICY of the command line.
        wire: that is spoken.
        maps: a file to write, with what clients of the other wires have to declare.
        serving: told the address once connections are answered.

    Raises:
        BadUsage: the policy cannot be served, or not there.
    """
    key = os.environ.get(KEY)
    if host not in LOOPBACK and not key:
        raise BadUsage(
            f"--host {host} is open to other machines; set {KEY} to a secret, which their clients "
            f"send {'as api_token' if wire == 'gr00t' else 'as Authorization: Api-Key'}, or leave "
            "--host out."
        )
    kind = _kind(wire, sessions)
    policy = _servable(text, Surroundings(timeout=timeout, threads=_threads(sessions)))
    if maps is not None:
        _write_maps(maps, wire, policy.cameras)
    try:
        server = kind(policy, sessions=sessions, model=_name(policy), key=key)
    except PolicyFailure as error:
        reason = str(error).removeprefix(policies.MISMATCH)
        raise BadUsage(f"{policy.text} cannot be loaded: {reason}") from None
    try:
        listening = server.listen(host, port)
    except OSError as error:
        server.close()
        raise BadUsage(f"Nothing can listen on {host}:{port}: {error.strerror}.") from None
    with listening, closing(server), suppress(KeyboardInterrupt):
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        serving(f"{SCHEMES[wire][0]}://{_place(host)}:{_port(listening)}")
        listening.serve_forever()


def _kind(wire: Wire, sessions: int) -> Any:
    """The class of servers that speak a wire."""
    if wire == "openpi":
        from workers.remote.serving import PolicyServer

        return PolicyServer
    if wire == "vla_eval":
        from workers.remote.serving_vla_eval import VlaEvalServer

        return VlaEvalServer
    if wire == "act":
        from workers.remote.serving_act import ActServer

        return ActServer
    if sessions != 1:
        raise BadUsage("--sessions: GR00T's wire tells no sessions apart; there can be one.")
    if find_spec("zmq") is None:
        raise BadUsage("GR00T's wire is ZeroMQ: pip install pyzmq.")
    from workers.remote.serving_gr00t import Gr00tServer

    return Gr00tServer


def _write_maps(path: Path, wire: Wire, cameras: Sequence[str]) -> None:
    from workers.remote.maps import ActionMap, as_toml, everything

    try:
        path.write_text(as_toml(wire, everything(cameras), ActionMap()))
    except OSError as error:
        raise BadUsage(f"--write-maps {path}: {error.strerror}.") from None


def _port(listening: Any) -> int:
    if hasattr(listening, "port"):
        return int(listening.port)
    return int(listening.socket.getsockname()[1])


def _servable(text: str, surroundings: Surroundings) -> Hosted:
    try:
        policy = policies.parse(text, surroundings)
    except BadPolicy as error:
        raise BadUsage(str(error)) from None
    if isinstance(policy, Checkpoint) and not policies.has_torch():
        raise BadUsage(f"{policy.text} cannot be served: {policies.NO_TORCH}.")
    if not isinstance(policy, Hosted) or isinstance(policy, Remote):
        raise BadUsage(
            f"'{text}' is not served: it would need the simulator, or is elsewhere already. Serve "
            "a checkpoint, seek-small or path/to/file.safetensors, or a class, python:module:Class."
        )
    return policy


def _name(policy: Hosted) -> str:
    """What clients are told that it is; nothing of this machine's folders."""
    if isinstance(policy, Checkpoint):
        from seek_model.checkpoint_header import read_header

        return read_header(policy.path).config.name
    return policy.target.rpartition(":")[2]


def _threads(sessions: int) -> int:
    from workers.evaluation import count_cpus

    return max(1, count_cpus() // sessions)


def _place(host: str) -> str:
    return f"[{host}]" if ":" in host else host
