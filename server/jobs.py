"""What a worker is handed: a shard's episodes, its policy, its limits."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import lifecycle
from server.episodes import budget
from server.models import Decision, Episode, Shard
from workers.policy_process import LOAD_LIMIT
from workers.protocol import AssignedEpisode, PythonPolicy, ReplayPolicy, ShardJob


class CannotPlay(ValueError):
    """This server plays no such policy; the message says what would change that."""


def draft(
    session: Session, shard: Shard, *, server: str, episode_limit: float, allow_python: bool
) -> ShardJob:
    """The job of a shard whose attempt and token are not known yet.

    Args:
        server: address under which workers reach this server.
        episode_limit: seconds of wall time for one episode, the policy's own answers apart.

    Raises:
        CannotPlay: its policy is a class of this machine that is not allowed, or has changed.
        ValueError: what the ledger holds makes no job.
    """
    evaluation = shard.evaluation
    version = evaluation.policy_version
    if version.spec["kind"] == "python":
        _require_playable(PythonPolicy.model_validate(version.spec), allow_python)
    episodes = lifecycle.open_episodes(shard)
    return ShardJob.model_validate(
        {
            "attempt": "",
            "token": "",
            "server": server,
            "policy": version.spec,
            "policy_name": f"{version.policy.name}@{version.number}",
            "rules": evaluation.rules,
            "recordings": evaluation.recordings,
            "sources": evaluation.sources.get(shard.task),
            "episode_limit": _limit(version.spec, episodes, episode_limit),
            "episodes": [_assigned(session, version.spec, one) for one in episodes],
        }
    )


def _require_playable(policy: PythonPolicy, allowed: bool) -> None:
    if not allowed:
        raise CannotPlay("a class of this machine is played only with --allow-python; resume then")
    if policy.sha256 is not None and policy.file_hash() != policy.sha256:
        raise CannotPlay(f"{policy.target} is not what was registered; register it again")


def _assigned(session: Session, spec: dict[str, Any], episode: Episode) -> AssignedEpisode:
    actions = replayed(session, spec, episode) if spec["kind"] == "replay" else None
    return AssignedEpisode(id=episode.id, spec=lifecycle.spec_of(episode), actions=actions)


def _limit(spec: dict[str, Any], episodes: Sequence[Episode], limit: float) -> float:
    """Seconds after which an episode hangs; a slow policy is not to blame for that."""
    if spec["kind"] != "python":
        return limit
    answers = max(budget(episode) for episode in episodes) + 1  # and the reset
    return limit + LOAD_LIMIT + answers * PythonPolicy.model_validate(spec).timeout


def replayed(session: Session, spec: dict[str, Any], episode: Episode) -> tuple[Any, ...]:
    """The actions that were recorded of the same episode in the evaluation that is replayed."""
    source = ReplayPolicy.model_validate(spec).evaluation
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
