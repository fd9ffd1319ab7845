"""Wakes those who wait for the ledger to change, wherever they wait."""

import asyncio
import threading


class Bell:
    """Rung from any thread; heard by the event loop's followers.

    Attributes:
        reconciler: set when there may be something to hand out or to stop.
        committed: set when anything was committed.
    """

    def __init__(self) -> None:
        self.reconciler = threading.Event()
        self.committed = threading.Event()
        self.closing = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._changed: asyncio.Event | None = None

    def attach(self) -> None:
        """From now on the running event loop hears it."""
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()

    def ring(self) -> None:
        """Something was committed."""
        self.committed.set()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._tell)

    def _tell(self) -> None:
        assert self._changed is not None
        self._changed.set()
        self._changed = asyncio.Event()

    def next_ring(self) -> asyncio.Event:
        """What is set when it rings next; ask before looking, so that no ring is missed."""
        assert self._changed is not None, "attach comes first"
        return self._changed

    def close(self) -> None:
        """Sends the followers home."""
        self.closing = True
        self.ring()
