"""What a worker is handed: a shard's episodes, its policy, its limits."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from sqlalchemy import select
from sqlalchemy.orm import Session

from server import lifecycle
from server.blobs import Blobs
from server.episodes import budget
from server.models import Decision, Episode, Shard
from workers.policies import NO_TORCH, has_torch
from workers.protocol import (
    AssignedEpisode,
    CheckpointPolicy,
    HostedPolicy,
    PolicySpec,
    PythonPolicy,
    ReplayPolicy,
    ShardJob,
)
from workers.sandbox.choice import Sandbox
from workers.simulator_process import begin_limit

_SPEC: TypeAdapter[PolicySpec] = TypeAdapter(PolicySpec)


class CannotPlay(ValueError):
    """This server plays no such policy; the message says what would change that."""


def draft(
    session: Session,
    shard: Shard,
    *,
    store: Blobs,
    server: str,
    episode_limit: float,
    allow_python: bool,
    sandbox: Sandbox | None = None,
    hidden: tuple[Path, ...] = (),
    allow_remote: Sequence[str] = (),
) -> ShardJob:
    """The job of a shard whose attempt and token are not known yet.

    Args:
        store: holds checkpoints.
        server: address under which workers reach this server.
        episode_limit: seconds of wall time for one episode, the policy's own answers apart.
        sandbox: around the policy's process; None: the worker chooses.
        hidden: folders of this machine that no policy may see.
        allow_remote: where else than on the internet a remote policy may be.

    Raises:
        CannotPlay: its policy is a class of this machine that is not allowed, or has changed; or
            a checkpoint, and it or torch is not here.
        ValueError: what the ledger holds makes no job.
    """
    evaluation = shard.evaluation
    version = evaluation.policy_version
    policy = _SPEC.validate_python(version.spec)
    if isinstance(policy, PythonPolicy):
        _require_playable(policy, allow_python)
    if isinstance(policy, CheckpointPolicy):
        _require_loadable(policy, store)
    episodes = lifecycle.open_episodes(shard)
    return ShardJob.model_validate(
        {
            "attempt": "",
            "token": "",
            "server": server,
            "policy": policy,
            "policy_name": f"{version.policy.name}@{version.number}",
            "rules": evaluation.rules,
            "recordings": evaluation.recordings,
            "sources": evaluation.sources.get(shard.task),
            "sandbox": sandbox,
            "hidden": hidden,
            "allowed": tuple(allow_remote),
            "episode_limit": _limit(policy, episodes, episode_limit),
            "episodes": [_assigned(session, policy, one) for one in episodes],
        }
    )


def _require_playable(policy: PythonPolicy, allowed: bool) -> None:
    if not allowed:
        raise CannotPlay("a class of this machine is played only with --allow-python; resume then")
    if policy.sha256 is not None and policy.file_hash() != policy.sha256:
        raise CannotPlay(f"{policy.target} is not what was registered; register it again")


def _require_loadable(policy: CheckpointPolicy, store: Blobs) -> None:
    if not has_torch():
        raise CannotPlay(f"{NO_TORCH}; resume then")
    if not store.holds(policy.sha256):
        raise CannotPlay(f"the checkpoint {policy.sha256[:12]} is gone; upload it again")


def _assigned(session: Session, policy: PolicySpec, episode: Episode) -> AssignedEpisode:
    actions = None
    if isinstance(policy, ReplayPolicy):
        actions = replayed(session, policy.evaluation, episode)
    return AssignedEpisode(id=episode.id, spec=lifecycle.spec_of(episode), actions=actions)


def _limit(policy: PolicySpec, episodes: Sequence[Episode], limit: float) -> float:
    """Seconds after which an episode hangs; a slow policy is not to blame for that."""
    if not isinstance(policy, HostedPolicy):
        return limit
    answers = max(budget(episode) for episode in episodes) + 1  # and the reset
    return limit + begin_limit(policy) + answers * policy.timeout


def replayed(session: Session, source: str, episode: Episode) -> tuple[Any, ...]:
    """The actions that were recorded of the same episode in the evaluation that is replayed."""
    return tuple(
        session.scalars(
            select(Decision.action)
            .join(Episode, Decision.episode_id == Episode.id)
            .where(
                Episode.evaluation_id == source,
                Episode.task == episode.task,
                Episode.split == episode.split,
                Episode.index == episode.index,
            )
            .order_by(Decision.number)
        )
    )
