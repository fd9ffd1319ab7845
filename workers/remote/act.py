"""A policy behind OpenVLA's `POST /act`: an observation in JSON, answered by an action.

Nothing tells the server of a new episode, and every request has a connection of its own. The
answer is an array, rows in a list, or a map that has them; numbers may be arrays of json-numpy.
Source: vla-scripts/deploy.py of OpenVLA and OpenVLA-OFT; json-numpy 2.1.
"""

from typing import Any

from hide_tasks.contract import InvalidAction, Observation
from workers.remote import json_arrays, post
from workers.remote.actions import actions_of
from workers.remote.arrays import BadMessage
from workers.remote.client import Client, PeerError, declared_maps
from workers.remote.maps import cameras_in
from workers.remote.observations import told
from workers.remote.target import About, Target
from workers.remote.words import plain_text

PATH = "/act"  # if the URL has none


class ActPolicy(Client):
    """A policy behind OpenVLA's wire."""

    def close(self) -> None:
        """Does nothing: no connection outlives its request."""

    def _connect(self, patience: float) -> About:
        self._observation, self._action = declared_maps(self.target.policy)
        post.connect(self.target, patience).close()  # it has nothing to say of itself
        return About(dialect="act", cameras=cameras_in(self._observation))

    def _begin(self, instruction: str) -> None:
        """Does nothing: its server keeps no episode apart from another."""

    def _ask(self, observation: Observation) -> list[Any]:
        body = json_arrays.pack(told(observation, self._observation))
        try:
            reply = json_arrays.unpack(post.post(self.target, PATH, body))
        except BadMessage as error:
            raise InvalidAction(f"no reply that may be read: {error}") from None
        if isinstance(reply, str):  # OpenVLA says "error", with status 200
            raise PeerError(f"the server says: {plain_text(reply)}")
        return actions_of(self._named(reply), self._action)

    def _named(self, reply: Any) -> dict[Any, Any]:
        if isinstance(reply, dict):
            if self._action.kind == "action":
                return reply
            return {name: json_arrays.stacked(value) for name, value in reply.items()}
        return {name: json_arrays.stacked(reply) for name in self._action.names}


def load(target: Target) -> ActPolicy:
    """The policy at a target; nothing is connected yet."""
    return ActPolicy(target)
