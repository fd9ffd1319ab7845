"""A server that others reach asks who they are, and keeps policies in a sandbox."""

import pytest

from server.arguments import BadUsage
from server.exposure import authenticates, require_safe
from server.settings import LOOPBACK, Settings
from workers.sandbox.choice import Sandbox


@pytest.mark.parametrize("host", LOOPBACK)
def test_on_this_machine_alone_nothing_is_asked_for(host: str) -> None:
    require_safe(host, authentication=False, sandbox=Sandbox.NONE)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.7", "lab.example"])
@pytest.mark.parametrize(
    ("authentication", "sandbox", "message"),
    [
        (False, Sandbox.BUBBLEWRAP, "without log-in"),
        (False, Sandbox.NONE, "without log-in"),
        (True, Sandbox.NONE, "without a sandbox"),
    ],
)
def test_others_reach_it_only_with_both(
    host: str, authentication: bool, sandbox: Sandbox, message: str
) -> None:
    with pytest.raises(BadUsage, match=f"--host {host}: {message}"):
        require_safe(host, authentication=authentication, sandbox=sandbox)


@pytest.mark.parametrize("sandbox", [Sandbox.BUBBLEWRAP, Sandbox.LANDLOCK])
def test_with_both_they_do(sandbox: Sandbox) -> None:
    require_safe("0.0.0.0", authentication=True, sandbox=sandbox)


def test_there_is_no_log_in_yet() -> None:
    assert not authenticates(Settings(host="0.0.0.0"))
