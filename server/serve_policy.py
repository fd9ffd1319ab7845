"""`hide serve-policy`: one of our own policies, for whoever evaluates it over a WebSocket."""

import os
import signal
from collections.abc import Callable
from contextlib import closing, suppress

from hide_tasks.contract import PolicyFailure
from server.arguments import BadUsage
from server.settings import LOOPBACK
from workers import policies
from workers.policies import BadPolicy, Checkpoint, Hosted, Remote, Surroundings

KEY = "HIDE_POLICY_KEY"


def serve_policy(
    text: str,
    *,
    host: str,
    port: int,
    sessions: int,
    timeout: float,
    serving: Callable[[str], object],
) -> None:
    """Serves until SIGINT or SIGTERM.

    Args:
        text: POLICY of the command line.
        serving: told the address once connections are answered.

    Raises:
        BadUsage: the policy cannot be served, or not there.
    """
    from workers.remote.serving import PolicyServer

    key = os.environ.get(KEY)
    if host not in LOOPBACK and not key:
        raise BadUsage(
            f"--host {host} is open to other machines; set {KEY} to a secret, which their clients "
            "send as Authorization: Api-Key, or leave --host out."
        )
    policy = _servable(text, Surroundings(timeout=timeout, threads=_threads(sessions)))
    try:
        server = PolicyServer(policy, sessions=sessions, model=_name(policy), key=key)
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
        serving(f"ws://{_place(host)}:{listening.socket.getsockname()[1]}")
        listening.serve_forever()


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
            "a checkpoint, path/to/file.safetensors, or a class, python:module:Class."
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
