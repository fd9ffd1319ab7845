"""Whether a server may be reached from other machines."""

from server.arguments import BadUsage
from server.settings import LOOPBACK, Settings
from workers.sandbox.choice import Sandbox


def authenticates(_settings: Settings) -> bool:
    """True if whoever asks the server must say who they are: the one place that knows.

    There is no log-in yet.
    """
    return False


def require_safe(host: str, *, authentication: bool, sandbox: Sandbox) -> None:
    """Does nothing if a server may listen on this address.

    Args:
        host: where it would listen.
        authentication: whoever asks it must say who they are.
        sandbox: what it puts around the processes of policies.

    Raises:
        BadUsage: others would reach it, and it would not be safe from them.
    """
    if host in LOOPBACK:
        return
    if not authentication:
        raise BadUsage(
            f"--host {host}: without log-in the server listens on this machine alone; "
            "use 127.0.0.1 and reach it through an SSH tunnel."
        )
    if sandbox is Sandbox.NONE:
        raise BadUsage(
            f"--host {host}: without a sandbox around policies the server listens on this machine "
            "alone; hide doctor says what is missing. Use 127.0.0.1 and an SSH tunnel until then."
        )
