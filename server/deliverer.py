"""Sends what webhooks are told, one delivery of each at a time, beside everything else.

A receiver is a stranger's address. Where it leads is looked up once and every address looked at
(workers/remote/egress.py); no redirect is followed, no proxy asked, nothing of the answer read but
its status, and all of it has a few seconds.
"""

import logging
import ssl
import threading
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from time import monotonic
from typing import Any

import httpcore
from standardwebhooks import Webhook as Signer

from server import webhooks
from server.bell import Bell
from server.db import Database
from server.models import Delivery, now
from server.webhooks import Outcome
from workers.remote import egress

logger = logging.getLogger(__name__)
WITHIN = 15.0  # s for one try, as the specification suggests at least
AT_A_TIME = 4  # receivers
CALM = 0.2  # s between two looks at the ledger
PRUNED_EVERY = 86_400.0  # s
PATIENCE = 60.0  # s between two looks when nothing happens


class Deliverer:
    """Looks at the ledger whenever something was committed, and sends what is due.

    Args:
        allowed: where else than on the internet and over TLS receivers may be.
    """

    def __init__(self, database: Database, bell: Bell, allowed: Sequence[str]):
        self.database, self.bell, self.allowed = database, bell, tuple(allowed)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="deliverer", daemon=True)
        self._busy: set[str] = set()  # webhooks of which a delivery is under way
        self._noting = threading.Lock()
        self._prune_at = monotonic()

    def start(self) -> None:
        """Begins to look."""
        self._thread.start()

    def stop(self) -> None:
        """Ends at once; nothing is noted any more, so what is under way is sent again later."""
        with self._noting:
            self._stopping.set()
        self.bell.committed.set()
        if self._thread.is_alive():
            self._thread.join(timeout=30)

    def _run(self) -> None:
        while not self._stopping.is_set():
            self.bell.committed.clear()
            wait = PATIENCE
            try:
                wait = self.look()
            except Exception:  # a full disk or a locked file must not end the loop
                logger.exception("The deliveries of webhooks failed; they are tried again")
            self.bell.committed.wait(wait)
            self._stopping.wait(CALM)

    def look(self) -> float:
        """Makes deliveries of new events and begins those that are due; s until the next is."""
        with self.database.reading() as session:
            behind = webhooks.behind(session)
        if behind or monotonic() >= self._prune_at:
            with self.database.writing() as session:
                webhooks.collect(session)
                webhooks.prune(session, now())
            self._prune_at = monotonic() + PRUNED_EVERY
        with self.database.reading() as session:
            for row in webhooks.due(session, now(), self._busy)[: AT_A_TIME - len(self._busy)]:
                self._busy.add(row.webhook_id)
                session.expunge(row)
                threading.Thread(target=self._deliver, args=[row], daemon=True).start()
            later = webhooks.next_due(session, self._busy)
        if later is None or len(self._busy) >= AT_A_TIME:
            return PATIENCE  # whatever ends wakes this loop
        return min(max((later - now()).total_seconds(), CALM), PATIENCE)

    def _deliver(self, row: Delivery) -> None:
        try:
            outcome = send(row, self.allowed)
            with self._noting:
                if not self._stopping.is_set():
                    self._note(row.id, outcome)
        except Exception:
            logger.exception("A delivery failed; it is tried again", extra={"delivery": row.id})
            self._stopping.wait(PATIENCE)  # what cannot be noted must not be sent all the time
        finally:
            self._busy.discard(row.webhook_id)
            self.bell.committed.set()

    def _note(self, id: str, outcome: Outcome) -> None:
        with self.database.writing() as session:
            if row := webhooks.delivery(session, id):  # else it was removed meanwhile
                webhooks.note(row, outcome, now())


def send(row: Delivery, allowed: Sequence[str] = (), within: float = WITHIN) -> Outcome:
    """Sends a delivery once, signed."""
    try:
        peer = egress.parse_url(row.webhook.url, webhooks.SCHEMES)
        return Outcome(status=_post(peer, row, allowed, within))
    except egress.Forbidden as error:
        return Outcome(error=f"not allowed: {error}")
    except (httpcore.TimeoutException, TimeoutError):
        return Outcome(error=f"no answer within {within:g} s")
    except (httpcore.NetworkError, httpcore.ProtocolError, OSError, ssl.SSLError) as error:
        return Outcome(error=f"{type(error).__name__}: {error}"[:300])


def _post(peer: egress.Peer, row: Delivery, allowed: Sequence[str], within: float) -> int:
    backend = _Vetted(peer, allowed, monotonic() + within)
    body = row.body.encode()
    headers = {
        "Host": peer.place.removesuffix(f":{egress.PORTS[peer.scheme]}"),
        "Content-Type": "application/json",
        "Content-Length": str(len(body)),
        "User-Agent": "hide-seek-webhooks",
        "Connection": "close",
        **signed(row, now()),
    }
    context = egress.tls(peer)
    with (
        httpcore.ConnectionPool(ssl_context=context, network_backend=backend, retries=0) as pool,
        pool.stream("POST", peer.url, headers=list(headers.items()), content=body) as answer,
    ):
        return answer.status


def signed(row: Delivery, moment: datetime) -> dict[str, str]:
    """The headers by which the receiver knows that a delivery is ours, and new."""
    moment = moment.astimezone(UTC).replace(microsecond=0)
    return {
        "webhook-id": row.id,
        "webhook-timestamp": str(int(moment.timestamp())),
        "webhook-signature": Signer(row.webhook.secret).sign(row.id, moment, row.body),
    }


class _Vetted(httpcore.NetworkBackend):
    """Connects to addresses that were looked at, and to no other."""

    def __init__(self, peer: egress.Peer, allowed: Sequence[str], deadline: float):
        self.peer, self.allowed, self.deadline = peer, allowed, deadline
        self._plain = httpcore.SyncBackend()

    def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,
        local_address: str | None = None,
        socket_options: Iterable[Any] | None = None,
    ) -> httpcore.NetworkStream:
        """A connection to the first address that takes it; `host` was resolved by us."""
        fault: Exception = httpcore.ConnectError(f"{self.peer.host} has no address")
        for address in egress.resolve(self.peer, self.allowed):
            try:
                connection = self._plain.connect_tcp(address, port, timeout=_left(self.deadline))
            except (httpcore.ConnectError, httpcore.ConnectTimeout) as error:
                fault = error
                continue
            return _Bounded(connection, self.deadline)
        raise fault


class _Bounded(httpcore.NetworkStream):
    """A connection all of whose doings together have until a deadline."""

    def __init__(self, connection: httpcore.NetworkStream, deadline: float):
        self.connection, self.deadline = connection, deadline

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        """What comes next."""
        return self.connection.read(max_bytes, _left(self.deadline))

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        """Sends."""
        self.connection.write(buffer, _left(self.deadline))

    def close(self) -> None:
        """Ends it."""
        self.connection.close()

    def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,
    ) -> httpcore.NetworkStream:
        """The same connection, in TLS."""
        secure = self.connection.start_tls(ssl_context, server_hostname, _left(self.deadline))
        return _Bounded(secure, self.deadline)

    def get_extra_info(self, info: str) -> Any:
        """What is known of the connection."""
        return self.connection.get_extra_info(info)


def _left(deadline: float) -> float:
    left = deadline - monotonic()
    if left <= 0:
        raise TimeoutError("timed out")
    return left
