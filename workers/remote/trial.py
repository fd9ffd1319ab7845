"""What a policy's server answers when it is tried: reached, asked what it is, asked for a decision.

Nothing is registered, and no simulator is needed; the connection is made as a worker makes it, from
a process of its own and past the same guards.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from hide_tasks.contract import Action, InvalidAction, Keyframe, PolicyFailure, Stop, parse_action
from workers.policies import BadPolicy, Remote
from workers.policy_process import NotStarted
from workers.preflight import INSTRUCTION, SEED, made_up
from workers.protocol import RemotePolicy
from workers.remote.keys import BadKeys
from workers.remote.target import About, RemoteProcess, Unreachable

DECISION_LIMIT = 30.0  # s: whoever tries a server waits for it

HINTS = {  # by what the message of a failure holds
    "Connection refused": "Nothing listens there. Is the server running, and is the port right?",
    "timed out": "It does not answer. Is there a firewall, or does it listen on its own machine "
    "alone?",
    "nothing came in": "Something listens, but says nothing: is the wire the right one?",
    "not known": "There is no machine of this name.",
    "No address associated": "There is no machine of this name.",
    "is no such server": "Something answers, but not as this wire does: is the wire the right one?",
    "is no URL such as": "The wire decides how the address begins: openpi and vla_eval ws:// or "
    "wss://, act http:// or https://, gr00t tcp://.",
    "not encrypted": "The operator names what may be reached without TLS: hide serve "
    "--allow-remote HOST:PORT.",
    "not a public address": "The operator names what may be reached beside the internet: hide "
    "serve --allow-remote HOST:PORT.",
    "does not say": "Give what it sees and how it acts below, as docs/remote_policies.md says.",
    "took longer": "The first decision of some policies compiles; try again, or raise the limits "
    "of the registration.",
}


class Step(BaseModel):
    """One thing that was tried."""

    model_config = ConfigDict(frozen=True)

    name: Literal["address", "connection", "decision"]
    outcome: Literal["passed", "failed"]
    seconds: float
    detail: str = ""
    hint: str = ""  # what to do about it


class Trial(BaseModel):
    """What came of it."""

    about: About | None  # null: it was not reached
    steps: list[Step]

    @property
    def fits(self) -> bool:
        """True if it can be registered; a decision that failed does not hinder that."""
        return self.about is not None


class _Failed(Exception):
    """A step failed; the steps say why."""


def tried(spec: RemotePolicy, allowed: tuple[str, ...]) -> Trial:
    """Tries the server at an address.

    Args:
        spec: as it would be registered.
        allowed: see `egress.resolve`.
    """
    steps: list[Step] = []
    about = None
    try:
        with _step(steps, "address"):
            process = _process(Remote.of_spec(spec, allowed))
        try:
            about = _connected(process, steps)
            _decided(process, steps)
        finally:
            process.close()
    except _Failed:
        pass
    return Trial(about=about, steps=steps)


def _process(remote: Remote) -> RemoteProcess:
    process = remote.make()
    process.timeout = min(process.timeout, DECISION_LIMIT)
    process.first_timeout = min(process.first_timeout or DECISION_LIMIT, DECISION_LIMIT)
    return process


def _connected(process: RemoteProcess, steps: list[Step]) -> About:
    process.load()  # it is not the server that this waits for
    with _step(steps, "connection") as told:
        about = process.open(patience=0.0)
        told(f"{about.dialect}" + (f", model {about.model}" if about.model else ""))
    return about


def _decided(process: RemoteProcess, steps: list[Step]) -> None:
    with _step(steps, "decision") as told:
        process.reset(INSTRUCTION, SEED)
        told(_words(parse_action(process.act(made_up()))))


def _words(action: Action) -> str:
    if isinstance(action, Stop):
        return "stop"
    if isinstance(action, Keyframe):
        return "a keyframe at ({:.2f}, {:.2f}, {:.2f}) m".format(*action.position)
    return f"{len(action.chunk)} steps of {action.kind.replace('_', ' ')}"


@contextmanager
def _step(
    steps: list[Step], name: Literal["address", "connection", "decision"]
) -> Iterator[Callable[[str], Any]]:
    """Adds what came of a block; what it tells is the detail.

    Raises:
        _Failed: it failed.
    """
    said: list[str] = []
    begun = monotonic()

    def add(outcome: Literal["passed", "failed"], detail: str, hint: str = "") -> None:
        seconds = round(monotonic() - begun, 3)
        steps.append(Step(name=name, outcome=outcome, seconds=seconds, detail=detail, hint=hint))

    try:
        yield said.append
    except (BadPolicy, BadKeys, Unreachable, PolicyFailure, InvalidAction, NotStarted) as error:
        text = str(error)
        add("failed", text, next((hint for part, hint in HINTS.items() if part in text), ""))
        raise _Failed from None
    add("passed", "; ".join(said))
