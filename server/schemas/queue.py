"""What waits, and what is played."""

from datetime import datetime
from enum import StrEnum
from typing import Literal

from pydantic import BaseModel

from server.states import EvaluationState


class QueueReason(StrEnum):
    """Why shards wait."""

    NO_WORKERS = "no_workers"  # this server hands nothing out
    DISK_FULL = "disk_full"
    POLICY_BUSY = "policy_busy"  # the server of a remote policy plays as many as it takes
    WORKERS_BUSY = "workers_busy"
    OTHERS_FIRST = "others_first"


class QueueItem(BaseModel):
    """An evaluation of which shards wait."""

    position: int  # from 1
    evaluation: str
    policy: str
    version: int
    owner: str | None
    priority: int
    state: EvaluationState
    waiting: int  # shards
    running: int  # shards
    before: int  # shards of evaluations that stand before it
    reason: QueueReason
    detail: str  # the reason in a sentence


class Queue(BaseModel):
    """Evaluations in the order in which their next shards are handed out."""

    evaluations: int  # that wait
    shards: int
    items: list[QueueItem]  # the first of them


class WorkerPublic(BaseModel):
    """A shard that is handed out, and how far whoever plays it is."""

    attempt: str
    engine: str
    doing: Literal["begins", "plays", "between"]  # its first, an, or two episodes
    evaluation: str
    policy: str
    version: int
    task: str
    fence: int
    since: datetime
    episode: str | None  # that is played
    index: int | None
    episode_since: datetime | None
    final: int  # episodes of the shard
    episodes: int


class Workers(BaseModel):
    """What is handed out. A server keeps as many shards again at hand as it has slots."""

    slots: int  # shards that this machine plays at a time
    playing: int
    items: list[WorkerPublic]  # the longest at it first
