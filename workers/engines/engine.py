"""What the reconciler asks of whatever places processes. An engine keeps no truth.

Ask for the inventory first and for what ended afterwards: a key that ends in between is then in
one of the two answers.
"""

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True)
class Ended:
    """A key whose work is over."""

    key: str
    reason: str | None  # why it came to nothing; None: the function returned
    cancelled: bool = False
    result: object = None  # what the function returned, where the engine can tell


class Engine(Protocol):
    """Runs one function over jobs, each in a process that can be killed.

    Every method may be called from any thread. An engine that was given `on_ended` calls it, from
    a thread of its own, whenever there is something new in `ended`.

    Attributes:
        name: as attempts are marked that it runs.
    """

    name: str

    def submit(self, key: str, job: Any, limit: float) -> None:
        """Queue a job for at most `limit` seconds of work; a key of the inventory is left alone."""

    def cancel(self, key: str) -> None:
        """Drop a key and kill what runs for it; does nothing for a key that is not there."""

    def inventory(self) -> set[str]:
        """Keys that are queued or running."""

    def ended(self) -> list[Ended]:
        """Everything that ended since the last call."""

    def close(self) -> None:
        """Kill everything, in less than 5 s; nothing is submitted afterwards."""
