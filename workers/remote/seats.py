"""Policy processes that are served: so many sessions at a time, each with a process to itself."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any

from hide_tasks.contract import Observation
from workers.policies import Hosted
from workers.policy_process import PolicyProcess

SEAT_LIMIT = 2.0  # s for a session that is just ending to make room
LOOK_EVERY = 0.2  # s between two looks whether a client is still there
SEED = 0  # of every session: nothing that tells episodes apart crosses the wire


class BadRequest(ValueError):
    """A message that a client should not have sent."""


class Seat:
    """A policy process and the thread that starts it: on Linux it ends with that thread."""

    def __init__(self, process: PolicyProcess):
        self.process = process
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="policy")

    def call(self, function: Callable[[], Any], wanted: Callable[[], bool] = lambda: True) -> Any:
        """What the function returns, called in the process's thread.

        Args:
            wanted: asked again and again; the process is killed when nobody wants its answer.
        """
        asked = self._thread.submit(function)
        while not wait([asked], timeout=LOOK_EVERY).done:
            if not wanted():
                self.process.kill()
        return asked.result()

    def close(self) -> None:
        """Ends the process, and so whatever is asked of it."""
        self.process.kill()
        self._thread.submit(self.process.close)
        self._thread.shutdown()


class Seats:
    """Places for sessions.

    Args:
        policy: what is served.
        count: how many sessions there are at a time.

    Raises:
        PolicyFailure: it cannot be loaded.
    """

    def __init__(self, policy: Hosted, count: int):
        self._free: SimpleQueue[Seat] = SimpleQueue()
        self._all = [Seat(policy.make()) for _ in range(count)]
        for seat in self._all:
            try:
                seat.call(seat.process.load)
            except BaseException:
                self.close()
                raise
            self._free.put(seat)

    @contextmanager
    def taken(self) -> Iterator[Seat | None]:
        """A place, which is free again afterwards; None: they are all taken, and stay so."""
        try:
            seat = self._free.get(timeout=SEAT_LIMIT)
        except Empty:
            yield None
            return
        try:
            yield seat
        finally:
            self._free.put(seat)

    def close(self) -> None:
        """Ends every process, whatever it is doing."""
        for seat in self._all:
            seat.close()


def acted(process: PolicyProcess, observation: Observation) -> dict[str, Any]:
    """The reply to an observation: the action, what the policy believes, how long it took."""
    began = monotonic()
    action = process.act(observation)
    belief = process.belief()
    reply = {"action": action, "server_timing": {"infer_ms": 1e3 * (monotonic() - began)}}
    if belief is not None:
        reply["belief"] = belief.model_dump(mode="json")
    return reply


def text_of(message: Mapping[Any, Any], name: str, longest: int = 10_000) -> str:
    """A text in a message.

    Raises:
        BadRequest: it is missing, something else or too long.
    """
    value = message.get(name)
    if not isinstance(value, str) or len(value) > longest:
        found = "missing" if value is None else type(value).__name__
        raise BadRequest(f"{name} is {found}; expected a text of at most {longest} characters")
    return value
