"""The states of everything in the ledger, each with its meaning, and the moves between them.

The database enforces the same moves by triggers (migrations/versions/0001_ledger.py).
"""

from enum import StrEnum


class EvaluationState(StrEnum):
    """Where an evaluation stands; `server/lifecycle.py` alone moves it."""

    QUEUED = "queued"  # no shard of it was handed out yet
    RUNNING = "running"  # some shard is, or was, handed out
    COMPLETED = "completed"  # every episode is final
    INCOMPLETE = "incomplete"  # some shards failed for good; may be resumed
    CANCELLED = "cancelled"  # stopped on request; what was final stays


class Desired(StrEnum):
    """What the users of an evaluation want of it."""

    FINISHED = "finished"
    CANCELLED = "cancelled"


class ShardState(StrEnum):
    """Where a shard stands."""

    PENDING = "pending"  # waits to be handed out
    LEASED = "leased"  # has an open attempt
    DONE = "done"  # all its episodes are final
    FAILED = "failed"  # its attempts are used up
    CANCELLED = "cancelled"  # its evaluation was cancelled before it was done


class AttemptState(StrEnum):
    """Where an attempt stands; the last three never change."""

    OPEN = "open"  # may commit
    DONE = "done"  # ended, and every episode of its shard is final
    LOST = "lost"  # ended, with episodes left to play
    CANCELLED = "cancelled"  # stopped on request


class EpisodeState(StrEnum):
    """Where an episode stands."""

    PENDING = "pending"  # is to be played
    RUNNING = "running"  # is being played by an open attempt
    FINAL = "final"  # is committed, and immutable


class DeliveryState(StrEnum):
    """Where a webhook's delivery stands."""

    PENDING = "pending"  # is to be sent, or sent again
    DELIVERED = "delivered"  # was answered with 2xx
    FAILED = "failed"  # its tries are used up, or its receiver is gone


class WebhookEvent(StrEnum):
    """What a webhook may be told of."""

    EVALUATION_QUEUED = "evaluation.queued"
    EVALUATION_RUNNING = "evaluation.running"
    EVALUATION_COMPLETED = "evaluation.completed"
    EVALUATION_INCOMPLETE = "evaluation.incomplete"
    EVALUATION_CANCELLED = "evaluation.cancelled"
    EPISODE_FINAL = "episode.final"
    EPISODE_FAULT = "episode.fault"  # the infrastructure failed, not the policy
    EPISODE_DIVERGED = "episode.diverged"  # a second, different result was refused
    ATTEMPT_LOST = "attempt.lost"
    TRIAL = "webhook.trial"  # somebody tries the webhook


MOVES: dict[type[StrEnum], dict[str, tuple[str, ...]]] = {
    EvaluationState: {
        "queued": ("running", "completed", "incomplete", "cancelled"),
        "running": ("completed", "incomplete", "cancelled"),
        "incomplete": ("queued", "cancelled"),
        "completed": (),
        "cancelled": (),
    },
    ShardState: {
        "pending": ("leased", "failed", "cancelled"),
        "leased": ("pending", "done", "failed", "cancelled"),
        "failed": ("pending", "cancelled"),
        "done": (),
        "cancelled": (),
    },
    AttemptState: {
        "open": ("done", "lost", "cancelled"),
        "done": (),
        "lost": (),
        "cancelled": (),
    },
    EpisodeState: {
        "pending": ("running", "final"),
        "running": ("pending", "final"),
        "final": (),
    },
}

ENDED = (EvaluationState.COMPLETED, EvaluationState.INCOMPLETE, EvaluationState.CANCELLED)
