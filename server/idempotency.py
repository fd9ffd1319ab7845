"""What an idempotency key becomes in the ledger."""

import hashlib


def hashed(owner: str | None, key: str) -> str:
    """A key as it is stored: a user's own, whatever keys others choose."""
    return hashlib.sha256(f"{owner} {key}".encode()).hexdigest()
