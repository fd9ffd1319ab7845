"""The sandboxes that this machine has."""

import pytest

from workers.sandbox.choice import Sandbox, offer


def usable(sandbox: Sandbox) -> Sandbox:
    """The same one; skips the test where it cannot be had."""
    if missing := offer(sandbox).missing:
        pytest.skip(f"no {sandbox}: {missing}")
    return sandbox
