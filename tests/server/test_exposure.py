"""A server that others reach asks who they are, and keeps policies in a sandbox."""

import logging
from typing import Any

import pytest

from server.arguments import BadUsage
from server.exposure import require_safe
from server.settings import LOOPBACK, Settings
from workers.sandbox.choice import Sandbox

OUTSIDE: list[dict[str, Any]] = [
    {"host": "192.0.2.7"},
    {"host": "lab.example"},
    {"public_url": "https://lab.example"},
    {"host": "::", "public_url": "https://lab.example"},
]


@pytest.mark.parametrize("host", LOOPBACK)
def test_on_this_machine_alone_nothing_is_asked_for(host: str) -> None:
    require_safe(Settings(host=host), Sandbox.NONE)


@pytest.mark.parametrize("where", OUTSIDE)
def test_others_may_not_reach_one_that_asks_nobody(where: dict[str, Any]) -> None:
    with pytest.raises(BadUsage, match="--no-token"):
        require_safe(Settings(**where, token=False), Sandbox.BUBBLEWRAP)


@pytest.mark.parametrize("auth", ["local", "users"])
@pytest.mark.parametrize("where", OUTSIDE)
def test_others_may_not_reach_one_without_a_sandbox(where: dict[str, Any], auth: Any) -> None:
    with pytest.raises(BadUsage, match="without a sandbox"):
        require_safe(Settings(**where, auth=auth), Sandbox.NONE)


@pytest.mark.parametrize("auth", ["local", "users"])
@pytest.mark.parametrize("sandbox", [Sandbox.BUBBLEWRAP, Sandbox.LANDLOCK])
@pytest.mark.parametrize("where", OUTSIDE)
def test_with_both_they_do(where: dict[str, Any], sandbox: Sandbox, auth: Any) -> None:
    require_safe(Settings(**where, auth=auth), sandbox)


def test_every_address_needs_the_one_that_people_use() -> None:
    with pytest.raises(BadUsage, match="give --public-url"):
        require_safe(Settings(host="0.0.0.0"), Sandbox.BUBBLEWRAP)


def test_a_way_that_can_be_read_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        require_safe(Settings(public_url="http://lab.example"), Sandbox.BUBBLEWRAP)
        assert "No TLS" in caplog.text
        caplog.clear()
        require_safe(Settings(public_url="https://lab.example"), Sandbox.BUBBLEWRAP)

    assert not caplog.text
