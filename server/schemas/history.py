"""How an evaluation went, its log, and its publication."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel

from server.schemas.snapshots import SnapshotPublic

Outcome = Literal["exact", "success", "failed", "running", "lost"]
Activity = Literal["queued", "starting", "playing", "lost", "waiting", "stopped", "incomplete"]


class LaneSpan(BaseModel):
    """An episode as it was played once."""

    episode: str
    task: str
    index: int
    start: datetime
    end: datetime | None  # null: it is played now
    outcome: Outcome  # lost: that try was; another played it again


class Lane(BaseModel):
    """What was played one after the other, while other lanes went beside it."""

    number: int  # from 1
    spans: list[LaneSpan]


class Phase(BaseModel):
    """What an evaluation's time was spent on."""

    activity: Activity
    start: datetime
    end: datetime
    detail: str  # why nobody played


class HistoryPublic(BaseModel):
    """How an evaluation went in wall time."""

    start: datetime  # when it was asked for
    end: datetime  # now, while it runs
    running: bool
    lanes: list[Lane]
    phases: list[Phase]  # without gaps of a second or more
    seconds: dict[Activity, float]  # of each


class LogLine(BaseModel):
    """Something that happened to an evaluation, in words."""

    seq: int
    time: datetime
    level: str  # "", note, good or bad
    text: str
    episode: str | None


class WorkersLog(BaseModel):
    """What workers printed."""

    lines: list[str]  # the newest last


class PublicationPublic(BaseModel):
    """Whether an evaluation may be published, and where it was."""

    publishable: bool
    reason: str | None  # why not
    snapshots: list[SnapshotPublic]  # leaderboards that were kept with it in them
