"""Our own policies behind the wire of vla-evaluation-harness (see `workers.remote.vla_eval`).

Observations have what `maps.everything` declares; the reply is one action of our own form. What is
wrong is answered by an error that leaves the connection open, and the next episode begins afresh.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from websockets.sync.server import ServerConnection

from workers.policy_process import PolicyProcess
from workers.remote.arrays import BadMessage
from workers.remote.observations import observation_of
from workers.remote.seats import SEED, BadRequest, Seat, acted, text_of
from workers.remote.serving import BAD, IDLE_LIMIT, WebSocketServer, binary, still
from workers.remote.vla_eval import PROTOCOL, packed, unpack

Reply = tuple[str, Mapping[str, Any]]  # its type and its payload


class VlaEvalServer(WebSocketServer):
    """A policy behind vla-eval's wire."""

    def converse(self, connection: ServerConnection, seat: Seat) -> None:
        session = _Session(seat.process, self.model)
        while True:
            frame = connection.recv(timeout=IDLE_LIMIT)
            seq, reply = 0, None
            try:
                message = unpack(binary(frame))
                seq = _seq(message)
                answer = partial(session.answer, message["type"], message["payload"])
                reply = seat.call(answer, wanted=still(connection))
            except BAD as error:
                session.began = False
                reply = "error", {"error": str(error)}
            if reply is not None:
                kind, payload = reply
                connection.send(packed(kind, payload, seq))


def _seq(message: Mapping[Any, Any]) -> int:
    """What the answer repeats."""
    seq = message.get("seq", 0)
    if type(seq) is not int or not 0 <= seq < 2**63:
        raise BadMessage("seq is no number")
    return seq


class _Session:
    """The episodes of one connection."""

    def __init__(self, process: PolicyProcess, model: str):
        self._process, self._model = process, model
        self.began = False

    def answer(self, kind: str, payload: Mapping[Any, Any]) -> Reply | None:
        """The reply to a message; None if it is not answered."""
        if kind == "hello":
            return "hello", {"protocol_version": PROTOCOL, "model_server": self._model}
        if kind == "episode_start":
            self._begin(payload.get("task"))
            return None
        if kind == "episode_end":
            self.began = False
            return None
        if kind == "observation":
            return "action", self._act(payload)
        raise BadRequest(f"no type '{kind[:40]}'; there are hello, episode_start, observation")

    def _begin(self, task: object) -> None:
        if not isinstance(task, dict):
            raise BadRequest("episode_start has no task; expected {name: the instruction}")
        self._process.reset(text_of(task, "name"), SEED)
        self.began = True

    def _act(self, payload: Mapping[Any, Any]) -> dict[str, Any]:
        if not self.began:
            raise BadRequest("no episode is under way; send episode_start first")
        return acted(self._process, observation_of(payload))
