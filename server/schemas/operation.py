"""Whether the server is well, and what it says when it refuses."""

from typing import Literal

from pydantic import BaseModel

from workers.sandbox.choice import Sandbox


class Health(BaseModel):
    """Whether the server can do its work."""

    status: Literal["ok", "degraded"]
    checks: dict[str, str]
    workers: int
    sandbox: Sandbox  # around the processes of policies on the server's machine
    running: int  # attempts
    queued: int  # shards


class ProblemDocument(BaseModel):
    """An error of the API (RFC 9457)."""

    type: str
    title: str
    status: int
    code: str  # stable, for programs
    detail: str  # for people
    errors: list[dict[str, str]] = []  # {field, message} of each field that is wrong
