"""Leaderboards that are kept."""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel

from hide_tasks.contract import Split
from hide_tasks.suite import SUITE
from server.schemas.common import Description, Given, Verdict
from server.schemas.leaderboard import Leaderboard
from server.suites import BoardName


class SnapshotCreate(Given):
    """A snapshot to be taken."""

    suite: BoardName = SUITE
    split: Split = "test"
    note: Description = ""


class SnapshotPublic(BaseModel):
    """A leaderboard that was kept; it never changes."""

    number: int
    sha256: str  # of the bytes at `content`
    content: str  # path
    suite: str  # its name; its version stands in the content
    split: Split
    note: str
    created: datetime
    owner: str | None  # name of the user who took it


class SnapshotEvaluation(BaseModel):
    """What a row of a snapshot rests on."""

    evaluation: str
    policy_version: str
    results: str  # SHA-256 of its episodes' digests, one a line, by task and index
    sources: dict[str, str]  # per task, the code that played it
    machine: dict[str, Any]


class SnapshotContent(BaseModel):
    """The content of a snapshot."""

    format: Literal[1] = 1
    software: str
    statistics: str  # the methods
    episodes: str  # SHA-256 of what is played: names and scene hashes, one a line
    leaderboards: dict[Verdict, Leaderboard]
    evaluations: list[SnapshotEvaluation]
