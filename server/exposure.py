"""Whether a server may be reached from other machines."""

import logging

from server.arguments import BadUsage
from server.settings import EVERY_ADDRESS, Settings
from workers.sandbox.choice import Sandbox

logger = logging.getLogger(__name__)


def require_safe(settings: Settings, sandbox: Sandbox) -> None:
    """Does nothing if a server may listen where its settings say.

    Args:
        sandbox: what it puts around the processes of policies.

    Raises:
        BadUsage: others would reach it, and it would not be safe from them.
    """
    where = settings.public_url or settings.host
    if settings.beyond and settings.is_open:
        raise BadUsage(
            f"--no-token: others may reach {where} and would be its owner; leave it out, give "
            "--auth users, or use --host 127.0.0.1."
        )
    if settings.beyond and sandbox is Sandbox.NONE:
        raise BadUsage(
            f"Others may reach {where}, and without a sandbox their policies can do what this "
            "server can; hide doctor says what is missing. Until then listen on this machine "
            "alone, 127.0.0.1."
        )
    if settings.host in EVERY_ADDRESS and settings.public_url is None:
        raise BadUsage(
            f"--host {settings.host}: give --public-url, the address that people use, so that "
            "pages of other names are refused; or listen on this machine alone, 127.0.0.1."
        )
    if settings.beyond and not settings.secure:
        logger.warning("No TLS: passwords and tokens can be read on the way. See --public-url.")
