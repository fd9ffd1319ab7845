"""`hide worker` and `hide scheduler`: machines that play for a server elsewhere.

They know the server's address and a token; the server tells where the scheduler is, and what the
members of the cluster show each other. One that loses the scheduler comes back by itself.
"""

import asyncio
import contextlib
import logging
import os
import random
import signal
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from server.arguments import BadUsage

logger = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0  # s between two tries to join
LASTED = 60.0  # s after which a membership counts as one that went well

Server = Annotated[str, Argument(metavar="SERVER_URL", help="As hide serve --public-url says it.")]
TokenOption = Annotated[
    str | None,
    Option(
        envvar="HIDE_TOKEN",
        help="A token of the scope worker (hide token create USER --scope worker); with others "
        "about, say it as HIDE_TOKEN.",
    ),
]


def worker(
    server: Server,
    token: TokenOption = None,
    slots: Annotated[
        int | None, Option(min=1, max=256, help="Shards at a time; default: one per processor.")
    ] = None,
    sandbox: Annotated[
        str | None,
        Option(metavar="NAME", help="Around policies' processes: as for hide serve."),
    ] = None,
    log: Annotated[Path, Option(help="Takes what the processes print.")] = Path(os.devnull),
) -> None:
    """Play for a server on another machine; Ctrl-C stops, and what was played stays."""
    from workers.engines import member
    from workers.evaluation import count_cpus
    from workers.sandbox.choice import NoSandbox, chosen

    try:
        around = chosen(sandbox)
    except NoSandbox as error:
        raise BadUsage(str(error)) from None
    if around == "none" and sandbox != "none":
        raise BadUsage("No sandbox works here; see hide doctor, or say --sandbox none.")
    os.environ |= {member.SERVER: server, member.SANDBOX: around.value}

    def take_part(membership: Any) -> Coroutine[Any, Any, None]:
        count = slots or count_cpus()
        logger.warning("Joining %s with %d slots", membership.scheduler, count)
        security = membership.security()
        return member.take_part(membership.scheduler, slots=count, log=log, security=security)

    _stay(server, token, take_part)


def scheduler(
    server: Server,
    token: TokenOption = None,
    host: Annotated[str, Option(help="An address of this machine; default: all.")] = "",
    port: Annotated[int, Option(min=1, max=65535, help="As hide serve --scheduler says.")] = 8786,
) -> None:
    """Run the scheduler that a server's hide workers meet at; it listens with TLS only."""
    from workers.engines.scheduler import schedule

    _stay(server, token, lambda membership: schedule(host, port, security=membership.security()))


def _stay(
    server: str, token: str | None, take_part: Callable[[Any], Coroutine[Any, Any, None]]
) -> None:
    """Takes part until SIGINT or SIGTERM, again and again.

    Raises:
        BadUsage: the server does not let this machine in, or Dask is not installed.
    """
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise BadUsage("A cluster wants Dask: pip install 'hide-seek[dask]'.") from None
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt):
        _stay_until_interrupted(server, token, take_part)


def _stay_until_interrupted(
    server: str, token: str | None, take_part: Callable[[Any], Coroutine[Any, Any, None]]
) -> None:
    from workers.engines.membership import NoMember, ask

    pause = FIRST_PAUSE
    while True:
        began = time.monotonic()
        try:
            asyncio.run(take_part(ask(server, token)))
            why = "the scheduler went away"
        except NoMember as error:
            if error.final:
                raise BadUsage(str(error)) from None
            why = str(error)
        except (OSError, TimeoutError) as error:
            why = f"{type(error).__name__}: {error}"
        if time.monotonic() - began > LASTED:
            pause = FIRST_PAUSE
        logger.warning("Not in the cluster: %s; again in %.0f s", why, pause)
        time.sleep(pause * random.uniform(0.5, 1.0))
        pause = min(2 * pause, LONGEST_PAUSE)
