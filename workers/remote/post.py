"""One HTTP request to a policy server: no redirect, no proxy, no second connection, limited answer.

http.client asks nobody else: it is given a socket that is connected already.
"""

import http.client
from contextlib import ExitStack
from urllib.parse import urlsplit

from hide_tasks.contract import InvalidAction
from workers.remote import client, egress
from workers.remote.arrays import MAX_MESSAGE
from workers.remote.client import BadServer, PeerError, dial
from workers.remote.target import Target
from workers.remote.words import plain_text

SHOWN = 2000  # bytes of an error's text


def connect(target: Target, patience: float) -> http.client.HTTPConnection:
    """A connection over which one request can be sent.

    Raises:
        BadServer: it cannot be reached.
        Forbidden: it may not be connected to.
    """
    peer, raw = dial(target, patience)
    with ExitStack() as stack:
        stack.enter_context(raw)
        try:
            context = egress.tls(peer)
            there = context.wrap_socket(raw, server_hostname=peer.host) if context else raw
        except (OSError, ValueError) as error:  # of TLS, too
            reason = client.reason_of(error)
            raise BadServer(f"{target.policy.url} is no such server: {reason}") from None
        there.settimeout(None)  # the process has a limit
        connection = http.client.HTTPConnection(peer.host, peer.port)
        connection.auto_open = 0  # or it would resolve the name by itself
        connection.sock = there
        stack.pop_all()
        return connection


def post(target: Target, path: str, body: bytes) -> bytes:
    """The body of the answer to a POST of JSON.

    Raises:
        PeerError: the server is gone, or its answer has another status than 200.
        InvalidAction: the answer is too large.
    """
    parts = urlsplit(target.policy.url)
    query = f"?{parts.query}" if parts.query else ""
    there = (parts.path if parts.path.strip("/") else path) + query
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    if target.key:
        headers["Authorization"] = f"Api-Key {target.key}"
    connection = connect(target, 0.0)
    try:
        connection.request("POST", there, body, {**headers, "Connection": "close"})
        return _body(connection.getresponse())
    except (http.client.HTTPException, OSError) as error:
        raise PeerError(f"the server gave no answer: {client.reason_of(error)}") from None
    finally:
        connection.close()


def _body(response: http.client.HTTPResponse) -> bytes:
    if response.status != 200:
        text = plain_text(response.read(SHOWN).decode(errors="replace"))
        moved = "; redirects are not followed" if 300 <= response.status < 400 else ""
        raise PeerError(f"the server answered with HTTP status {response.status}{moved}: {text}")
    data = response.read(MAX_MESSAGE + 1)
    if len(data) > MAX_MESSAGE:
        raise InvalidAction(f"the reply has more than {MAX_MESSAGE} bytes")
    if response.length:
        raise PeerError(f"the server broke off {response.length} bytes before the reply's end")
    return data
