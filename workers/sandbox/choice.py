"""Which sandboxes there are, found out by trying them, and which one is taken."""

import os
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

CHOICE = "HIDE_SANDBOX"  # in the environment: the name of one, or best
BEST = "best"


class Sandbox(StrEnum):
    """The best first."""

    BUBBLEWRAP = "bubblewrap"  # namespaces of its own, and a filter of system calls
    LANDLOCK = "landlock"  # files closed by the kernel, and a filter of system calls
    NONE = "none"  # a process of its own


@dataclass(frozen=True)
class Offer:
    """What came of trying one."""

    sandbox: Sandbox
    missing: str = ""  # why it cannot be had; empty if it can


class NoSandbox(ValueError):
    """The sandbox that was asked for cannot be had; the message says why and what can."""


@cache
def offer(sandbox: Sandbox) -> Offer:
    """A sandbox, tried on this machine; takes a fraction of a second, once."""
    if sandbox is Sandbox.NONE:
        return Offer(sandbox)
    from workers.sandbox.trial import fault

    return Offer(sandbox, fault(sandbox))


def offers() -> list[Offer]:
    """Every sandbox, tried on this machine."""
    return [offer(one) for one in Sandbox]


def best() -> Sandbox:
    """The best one that can be had."""
    return next(one for one in Sandbox if not offer(one).missing)


def chosen(name: str | None = None) -> Sandbox:
    """The sandbox of this name; without one, what the environment says, else the best.

    Raises:
        NoSandbox: there is none of this name, or it cannot be had.
    """
    name = name or os.environ.get(CHOICE) or BEST
    if name == BEST:
        return best()
    try:
        wanted = Sandbox(name)
    except ValueError:
        raise NoSandbox(f"No sandbox '{name}'; there are {', '.join((BEST, *Sandbox))}.") from None
    if missing := offer(wanted).missing:
        usable = ", ".join(one.sandbox for one in offers() if not one.missing)
        raise NoSandbox(f"No sandbox {name} here: {missing}. There are {usable}.")
    return wanted
