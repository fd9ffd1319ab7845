"""What the clients of all wires share: episodes, actions given in advance, and what goes wrong."""

import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from hide_tasks.contract import Action, InvalidAction, Observation, parse_action
from workers.policy_host import plain
from workers.protocol import RemotePolicy
from workers.remote import egress
from workers.remote.maps import ActionMap, ObservationMap
from workers.remote.target import PATIENCE, About, Target
from workers.remote.words import plain_text

CONNECT_LIMIT = 10.0  # s for TCP, for TLS, and for a server to say what it is


class PeerError(Exception):
    """The server failed, or says that it did."""


class BadServer(ValueError):
    """It cannot be reached, or it is none that could be played with; says what would be right."""


class Client(ABC):
    """A policy of the contract. One instance plays many episodes, one after the other.

    Time limits are those of the process that this runs in, which is killed when it is late.

    Args:
        target: where it is; `open` connects.
    """

    def __init__(self, target: Target):
        self.target = target
        self._fresh = False  # no episode was played over the connection yet
        self._waiting: list[Any] = []  # actions that the server gave in advance
        self._belief: Any = None

    def open(self, patience: float = PATIENCE) -> About:
        """Connects anew for an episode and finds out whom it speaks to.

        Args:
            patience: seconds in which a connection that is refused is tried again.

        Raises:
            BadServer: it cannot be reached, or not be played with.
            Forbidden: it may not be connected to.
        """
        self.close()
        self._fresh = False
        about = self._connect(patience)
        self._fresh = True
        return about

    def reset(self, instruction: str, policy_seed: int) -> None:
        """A new episode: forget, and tell the server if it can be told.

        Raises:
            PeerError: the server failed.
            InvalidAction: it answered something else.
        """
        if not self._fresh:
            self.open()
        self._fresh = False
        self._waiting, self._belief = [], None
        self._begin(instruction)

    def act(self, observation: Observation) -> Action:
        """The next action; an answer of several keyframes is several actions.

        Raises:
            PeerError: the server failed.
            InvalidAction: it answered what is none, or not what was declared.
        """
        if not self._waiting:
            self._waiting = self._ask(observation)
        return _action(self._waiting.pop(0))

    def belief(self) -> Any:
        """What the server says that it believes."""
        return self._belief

    @abstractmethod
    def close(self) -> None:
        """Ends the connection, if there is one."""

    @abstractmethod
    def _connect(self, patience: float) -> About:
        """Connects, and finds out whom it speaks to."""

    @abstractmethod
    def _begin(self, instruction: str) -> None:
        """Tells the server of a new episode."""

    @abstractmethod
    def _ask(self, observation: Observation) -> list[Any]:
        """The server's actions, one at least."""


def _action(value: object) -> Action:
    try:
        return parse_action(plain(value))
    except InvalidAction as error:
        raise InvalidAction(plain_text(str(error))) from None


def declared_maps(policy: RemotePolicy) -> tuple[ObservationMap, ActionMap]:
    """What whoever registered a policy says that it sees, and how it acts.

    Raises:
        BadServer: nothing was said.
    """
    if policy.observation is None or policy.action is None:
        raise BadServer(
            f"{policy.url} speaks {policy.wire}, which does not say what it wants to see; "
            "declare `observation` and `action`"
        )
    return policy.observation, policy.action


def dial(target: Target, patience: float) -> tuple[egress.Peer, socket.socket]:
    """A connected socket; a server that starts anew is waited for.

    Raises:
        BadServer: there is none in so many seconds.
        Forbidden: it may not be connected to.
    """
    policy = target.policy
    peer = egress.parse_url(policy.url, policy.schemes)
    try:
        return peer, _dialled(peer, target.allowed, patience)
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadServer(f"{policy.url} cannot be reached: {reason}") from None


def _dialled(peer: egress.Peer, allowed: Sequence[str], patience: float) -> socket.socket:
    end, pause = time.monotonic() + patience, 0.1
    while True:
        try:
            return egress.connect(peer, allowed, CONNECT_LIMIT)
        except ConnectionRefusedError:
            if time.monotonic() + pause > end:
                raise
            time.sleep(pause)
            pause *= 2


def reason_of(error: Exception) -> str:
    """Why something went wrong, in words that may be shown."""
    if isinstance(error, TimeoutError):
        return f"nothing came in {CONNECT_LIMIT:g} s"
    return plain_text(str(error) or type(error).__name__)
