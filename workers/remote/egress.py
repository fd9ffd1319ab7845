"""Which addresses a worker may connect to when a stranger names them, and the connection itself.

The name is resolved once, every address that it has is looked at, and the socket goes to one of
those: a name that answers differently the second time gains nothing. Elsewhere than where the
operator allowed it, only public addresses are reached, and only over TLS.
"""

import ipaddress
import socket
import ssl
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from urllib.parse import urlsplit

LONGEST_URL = 500
PORTS = {"ws": 80, "wss": 443, "http": 80, "https": 443, "tcp": 5555}  # GR00T's is 5555
SECURE = ("wss", "https")
UNICAST = ipaddress.ip_network("2000::/3")  # all that is handed out of version 6
TUNNELS = tuple(map(ipaddress.ip_network, ("2002::/16", "2001::/32")))  # hold a version 4 address

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


class Forbidden(ValueError):
    """A URL that may not be connected to; the message says what would be right."""


@dataclass(frozen=True)
class Peer:
    """Where a URL leads."""

    url: str
    scheme: str
    host: str
    port: int

    @property
    def secure(self) -> bool:
        """True if TLS is spoken."""
        return self.scheme in SECURE

    @property
    def place(self) -> str:
        """host:port, as messages and allow-lists name it."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_url(url: str, schemes: Sequence[str] = ("ws", "wss")) -> Peer:
    """Where a URL leads; nothing is looked up.

    Raises:
        Forbidden: it is none that can be connected to.
    """
    if (
        len(url) > LONGEST_URL
        or not url.isascii()
        or not url.isprintable()
        or set(url) & set(" \\")
    ):
        raise Forbidden(f"a URL has at most {LONGEST_URL} printable ASCII characters, no space")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise Forbidden(f"'{url}' is no URL: {error}") from None
    if parts.scheme not in schemes or not host:
        raise Forbidden(f"'{url}' is no URL such as {schemes[0]}://host:8000")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise Forbidden("a URL has neither user, password nor fragment; a key is configured apart")
    if port == 0:
        raise Forbidden("port 0 is none")
    return Peer(url, parts.scheme, host, port or PORTS[parts.scheme])


def is_public(address: Address) -> bool:
    """True if an address is of the internet; one that wraps another address is not."""
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped:
            return is_public(address.ipv4_mapped)
        if address not in UNICAST or any(address in tunnel for tunnel in TUNNELS):
            return False
    return address.is_global and not address.is_multicast


def is_allowed(peer: Peer, addresses: Sequence[Address], allowed: Sequence[str]) -> bool:
    """True if the operator named the host, host:port, or a network that holds all addresses."""
    for entry in allowed:
        if entry.lower() in (peer.host, peer.place):
            return True
        with suppress(ValueError):
            network = ipaddress.ip_network(entry, strict=False)
            if addresses and all(address in network for address in addresses):
                return True
    return False


def resolve(peer: Peer, allowed: Sequence[str] = ()) -> list[str]:
    """The addresses of a peer, every one of which may be connected to.

    Args:
        peer: from `parse_url`.
        allowed: hosts, host:port and networks that the operator lets in, without TLS as well.

    Raises:
        Forbidden: some may not.
        OSError: the name is not known.
    """
    found = socket.getaddrinfo(peer.host, peer.port, type=socket.SOCK_STREAM)
    texts = list(dict.fromkeys(str(place[0]) for *_, place in found))
    addresses = [ipaddress.ip_address(text) for text in texts]
    if is_allowed(peer, addresses, allowed):
        return texts
    if not peer.secure:
        raise _unencrypted(peer)
    if not all(map(is_public, addresses)):
        raise Forbidden(
            f"{peer.host} is not a public address; the operator of this server may allow "
            f"{peer.place}"
        )
    return texts


def foresee(peer: Peer, allowed: Sequence[str] = ()) -> None:
    """Does nothing unless `resolve` would refuse a peer whatever its name stands for.

    Raises:
        Forbidden: it would.
    """
    numeric = True
    try:
        ipaddress.ip_address(peer.host)
    except ValueError:
        numeric = False
    if numeric:
        resolve(peer, allowed)  # asks nobody
    elif not peer.secure and not allowed:
        raise _unencrypted(peer)


def _unencrypted(peer: Peer) -> Forbidden:
    instead = f"use {peer.scheme}s://, or " if f"{peer.scheme}s" in SECURE else ""
    return Forbidden(
        f"{peer.scheme}:// to {peer.host} is not encrypted; {instead}have the operator allow "
        f"{peer.place}"
    )


def connect(peer: Peer, allowed: Sequence[str], within: float) -> socket.socket:
    """A connection to an address that was looked at.

    Raises:
        Forbidden: the peer may not be connected to.
        OSError: it cannot be reached; TimeoutError if not in so many seconds.
    """
    deadline = monotonic() + within
    error: OSError = ConnectionRefusedError(f"{peer.host} has no address")
    for address in resolve(peer, allowed):
        try:
            connection = socket.create_connection((address, peer.port), timeout=_left(deadline))
        except OSError as fault:
            error = fault
            continue
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection
    raise error


def _left(deadline: float) -> float:
    left = deadline - monotonic()
    if left <= 0:
        raise TimeoutError("timed out")
    return left


def tls(peer: Peer) -> ssl.SSLContext | None:
    """What checks a peer's certificate; None if none is spoken."""
    return ssl.create_default_context() if peer.secure else None
