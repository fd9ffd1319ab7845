"""Thousands of requests that no client would send: each is answered, none is a fault of ours.

HIDE_TEST_REQUESTS says how many; what is sent follows from its number alone.
"""

import errno
import json
import os
import random
import socket
from collections import Counter
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import pytest

from tests.server import ledgers
from tests.server.clients import API, PROBLEM, TestClient, client, hub_of, served
from workers.protocol import INTERNAL

REQUESTS = int(os.environ.get("HIDE_TEST_REQUESTS", "1500"))
METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE", "HEAD", "OPTIONS", "TRACE", "BREW")
HEADERS = (
    "accept", "authorization", "content-type", "content-length", "cookie", "if-none-match",
    "idempotency-key", "last-event-id", "origin", "range", "sec-fetch-site", "tus-resumable",
    "upload-checksum", "upload-length", "upload-metadata", "upload-offset", "x-forwarded-for",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 2**64, 10**400, 1e308, -0.5, "", " ", "\x00", "a" * 3000,
    "../../etc/passwd", "%00", "'; DROP TABLE episodes; --", "\ud83d\ude48", "\u202egnp.exe", "NaN",
    "{{7*7}}", "search_drawer", "expert", "expert@1", "test", "9" * 30, [], [[[]]], {}, {"": {}},
)  # fmt: skip


class Sender:
    """Makes requests up, from the routes there are and from none."""

    def __init__(self, routes: list[tuple[str, list[str], list[str]]], ids: list[str]):
        self.routes, self.ids = routes, ids

    def request(self, number: int) -> dict[str, Any]:
        """The request of a number."""
        dice = random.Random(number)
        path, methods, fields = dice.choice(self.routes)
        return {
            "method": dice.choice(methods) if dice.random() < 0.8 else dice.choice(METHODS),
            "url": self._path(dice, path),
            "params": self._query(dice),
            "headers": self._headers(dice),
            "content": self._body(dice, fields),
        }

    def _path(self, dice: random.Random, path: str) -> str:
        if dice.random() < 0.1:
            return API + "/" + quote(self._text(dice), safe=dice.choice(["", "/"]))
        while "{" in path:
            name = path[path.index("{") : path.index("}") + 1]
            known = dice.choice(self.ids) if dice.random() < 0.7 else self._text(dice)
            path = path.replace(name, quote(known, safe="") or "x", 1)
        return path

    def _text(self, dice: random.Random) -> str:
        text = "".join(map(str, dice.choices(VALUES, k=dice.randint(1, 3))))
        return text.encode("utf-8", "surrogatepass").decode("utf-8", "replace")[:2000]

    def _query(self, dice: random.Random) -> list[tuple[str, str]]:
        names = ("cursor", "limit", "split", "verdict", "task", "state", "policy", "name", "format")
        return [(dice.choice(names), self._text(dice)) for _ in range(dice.randint(0, 3))]

    def _headers(self, dice: random.Random) -> dict[str, str]:
        found = {
            name: self._text(dice).encode("ascii", "ignore").decode().translate(_NO_BREAK).strip()
            for name in dice.sample(HEADERS, dice.randint(0, 3))
        }
        if dice.random() < 0.7:
            found["content-type"] = "application/json"
        found.pop("content-length", None)  # of these the raw ones below lie
        return found

    def _body(self, dice: random.Random, fields: list[str]) -> bytes:
        kind = dice.random()
        if kind < 0.3:
            return b""
        if kind < 0.4:
            return dice.randbytes(dice.randint(1, 3000))
        if kind < 0.5:
            return b"[" * dice.choice([10, 100_000])
        wanted = fields or ["a"]
        document = {dice.choice(wanted): dice.choice(VALUES) for _ in range(dice.randint(1, 6))}
        return json.dumps(document).encode()


HUNG_UP = (errno.ECONNRESET, errno.EPIPE, errno.ENOTCONN)
_NO_BREAK = dict.fromkeys((*range(32), 127))


def sender_of(here: TestClient, ids: list[str]) -> Sender:
    """Knows the routes of the document and those that workers use."""
    document = here.get(f"{API}/openapi.json").json()
    schemas = document["components"]["schemas"]
    routes = []
    for path, methods in document["paths"].items():
        if path.endswith("/events"):
            continue  # a stream ends when its client goes
        for method, operation in methods.items():
            content = operation.get("requestBody", {}).get("content", {})
            named = content.get("application/json", {}).get("schema", {}).get("$ref", "")
            fields = list(schemas.get(named.rpartition("/")[2], {}).get("properties", {}))
            routes.append((path, [method.upper()], fields))
    for what in ("start", "recording", "result", "fault"):
        path = f"{INTERNAL}/attempts/{{attempt}}/episodes/{{episode}}/{what}"
        routes.append((path, ["POST", "PUT"], ["reason", "result", "decisions"]))
    return Sender(routes, ids)


@pytest.mark.slow
def test_no_random_request_is_a_fault_of_the_server(tmp_path: Path) -> None:
    with client(tmp_path) as here:
        hub = hub_of(here)
        done = ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=2)
        with hub.database.reading() as session:
            ids = [done, *(one.id for one in ledgers.episodes_of(session, done))]
        before = [here.get(f"{API}/episodes/{id}").json() for id in ids[1:]]
        sender = sender_of(here, [*ids, "expert", "noop@1", "search_drawer", "owner", "1"])

        found: Counter[int] = Counter()
        for number in range(REQUESTS):
            request = sender.request(number)
            answer = here.request(**request, follow_redirects=False)
            found[answer.status_code] += 1
            assert answer.status_code < 500, (number, request, answer.text)
            if answer.status_code >= 400 and answer.content:
                assert answer.headers["content-type"] == PROBLEM, (number, request)

        assert [here.get(f"{API}/episodes/{id}").json() for id in ids[1:]] == before
        assert here.get(f"{API}/health/ready").status_code == 200
    assert len(found) > 5, found  # they were of many kinds


@pytest.mark.parametrize(
    "sent",
    [
        b"GET /api/v1/tasks\r\n\r\n",
        b"GET \xff\xfe HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET /" + b"a" * 200_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"x: y\r\n" * 50_000 + b"\r\n",
        b"POST /api/v1/evaluations HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
        b"POST /api/v1/evaluations HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 3\r\n"
        b"Content-Length: 4\r\n\r\nabcd",
        b"POST /api/v1/evaluations HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\x00" * 200,
        b"\x00" * 1000,
    ],
    ids=range(9),
)
def test_what_is_no_http_is_refused_and_the_server_goes_on(tmp_path: Path, sent: bytes) -> None:
    with served(tmp_path) as (_, here):
        address = urlsplit(str(here.base_url))
        with socket.create_connection((address.hostname, address.port), timeout=10) as raw:
            try:
                raw.sendall(sent)
                raw.shutdown(socket.SHUT_WR)
                answer = raw.recv(100)
            except OSError as error:
                assert error.errno in HUNG_UP
                answer = b""  # it hung up before all of it had come

        assert not answer.startswith(b"HTTP/1.1 2")
        assert not answer.startswith(b"HTTP/1.1 5")
        assert here.get(f"{API}/health/live").status_code == 200
