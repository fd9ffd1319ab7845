import ipaddress
import socket

import pytest

from workers.remote import egress
from workers.remote.egress import Forbidden, foresee, is_allowed, is_public, parse_url, resolve


@pytest.mark.parametrize("text", ["1.1.1.1", "93.184.215.14", "2606:4700:4700::1111"])
def test_addresses_of_the_internet(text: str) -> None:
    assert is_public(ipaddress.ip_address(text))


@pytest.mark.parametrize(
    "text",
    [
        "127.0.0.1", "127.8.8.8", "0.0.0.0", "10.0.0.1", "172.16.3.4", "192.168.1.1",
        "169.254.169.254", "100.64.0.1", "224.0.0.1", "240.0.0.1", "255.255.255.255",
        "192.0.2.1", "198.18.0.1", "::", "::1", "::ffff:127.0.0.1", "::ffff:10.0.0.1",
        "::127.0.0.1", "64:ff9b::7f00:1", "64:ff9b::a9fe:a9fe", "64:ff9b:1::7f00:1",
        "2002:7f00:1::", "2001:0:7f00:1::1", "fe80::1", "fe80::1%eth0", "fc00::1", "fd00:ec2::254",
        "ff02::1", "2001:db8::1",
    ],
)  # fmt: skip
def test_addresses_that_a_stranger_may_not_name(text: str) -> None:
    assert not is_public(ipaddress.ip_address(text))


@pytest.mark.parametrize(
    ("url", "place"),
    [
        ("ws://host:8000", "host:8000"),
        ("wss://Example.ORG", "example.org:443"),
        ("ws://[::1]:9/path?x=1", "[::1]:9"),
        ("https://lab/act", "lab:443"),
        ("tcp://lab", "lab:5555"),
    ],
)
def test_where_a_url_leads(url: str, place: str) -> None:
    assert parse_url(url, ("ws", "wss", "https", "tcp")).place == place


@pytest.mark.parametrize(
    "url",
    [
        "", "ws://", "host:8000", "http://host", "file:///etc/passwd", "ws://host:port",
        "ws://host:70000", "ws://host:0", "ws://user:word@host", "ws://user@host", "ws://host/#x",
        "ws://ho st", "ws://host\r\nX: y", "ws://host\\@evil", "ws://h\u00f6st", "ws://[::1",
        "ws://" + "h" * 500,
    ],
)  # fmt: skip
def test_what_is_no_url(url: str) -> None:
    with pytest.raises(Forbidden):
        parse_url(url)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "127.1", "2130706433", "0x7f.1", "0"])
def test_this_machine_is_not_reached_under_any_of_its_names(host: str) -> None:
    with pytest.raises((Forbidden, OSError)):
        resolve(parse_url(f"wss://{host}"))


@pytest.mark.parametrize(
    "url", ["ws://lab.example", "wss://127.0.0.1", "wss://[::1]", "ws://1.1.1.1"]
)
def test_what_no_lookup_would_change_is_refused_without_one(url: str, monkeypatch) -> None:
    true = socket.getaddrinfo
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda *a, **k: true(*a, **k, flags=socket.AI_NUMERICHOST)
    )

    with pytest.raises(Forbidden):
        foresee(parse_url(url))
    foresee(parse_url(url), [parse_url(url).place])
    foresee(parse_url("wss://lab.example"))


def test_without_tls_only_what_the_operator_allows_is_reached() -> None:
    with pytest.raises(Forbidden, match="not encrypted; use wss://"):
        resolve(parse_url("ws://1.1.1.1:8000"))

    assert resolve(parse_url("ws://1.1.1.1:8000"), ["1.1.1.1:8000"]) == ["1.1.1.1"]
    assert resolve(parse_url("wss://1.1.1.1")) == ["1.1.1.1"]


@pytest.mark.parametrize(
    ("allowed", "right"),
    [
        (["localhost"], True),
        (["LOCALHOST:81"], True),
        (["127.0.0.0/8"], True),
        (["127.0.0.1"], True),
        (["localhost:82"], False),
        (["10.0.0.0/8"], False),
        (["host"], False),
        (["::/0"], False),
        ([""], False),
        ([], False),
    ],
)
def test_what_an_operator_allows(allowed: list[str], right: bool) -> None:
    peer = parse_url("ws://localhost:81")

    assert is_allowed(peer, [ipaddress.ip_address("127.0.0.1")], allowed) is right


def test_a_name_with_one_private_address_among_public_ones_is_refused(monkeypatch) -> None:
    def answers(*_: object, **__: object) -> list[tuple[object, ...]]:
        return [
            (socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, 443))
            for address in ("1.1.1.1", "169.254.169.254")
        ]

    monkeypatch.setattr(socket, "getaddrinfo", answers)

    with pytest.raises(Forbidden, match="rebinding is not a public address"):
        resolve(parse_url("wss://rebinding"))
    with pytest.raises(Forbidden):
        resolve(parse_url("wss://rebinding"), ["169.254.0.0/16"])


def test_a_name_is_resolved_once_and_its_address_connected_to(monkeypatch) -> None:
    asked = []
    true = socket.getaddrinfo

    def counts(host: str, *arguments: object, **named: object) -> object:
        asked.append(host)
        return true(host, *arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(socket, "getaddrinfo", counts)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        peer = parse_url(f"ws://localhost:{listener.getsockname()[1]}")
        egress.connect(peer, ["localhost"], 2.0).close()

    assert asked[0] == "localhost"
    assert "localhost" not in asked[1:]


def test_a_connection_that_is_never_made_is_given_up() -> None:
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        waiting = [socket.socket() for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex(full.getsockname())
        peer = parse_url(f"ws://127.0.0.1:{full.getsockname()[1]}")

        with pytest.raises(TimeoutError):
            egress.connect(peer, ["127.0.0.1"], 0.3)
        for one in waiting:
            one.close()
