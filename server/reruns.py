"""How to play an episode again without the server: its actions, and the commands that do it."""

import shlex
from collections.abc import Iterator

from sqlalchemy.orm import Session

from seek_model import trained
from server import episodes, evaluations, policies
from server.schemas.episodes import EpisodeDetail, RerunPublic
from server.schemas.evaluations import EvaluationPublic
from server.schemas.policies import PolicyVersionPublic
from workers.actions_file import ACTIONS_SUFFIX, EpisodeActions
from workers.protocol import (
    BuiltInPolicy,
    CheckpointPolicy,
    PythonPolicy,
    RemotePolicy,
    ReplayPolicy,
)

TIMEOUT = 60.0  # s for one answer, unless something else is said


def actions_of(session: Session, id: str) -> EpisodeActions:
    """Every action of an episode; none while it is not final.

    Raises:
        Problem: 404, there is no such episode.
    """
    episode = episodes.get(session, id)
    evaluation = evaluations.get(session, episode.evaluation)
    return EpisodeActions(
        suite=evaluation.suite,
        task=episode.task,
        split=episode.split,
        index=episode.index,
        rules=evaluation.rules,
        policy=f"{evaluation.policy}@{evaluation.version}",
        scene_hash=episode.scene_hash,
        final_state_hash=episode.final_state_hash,
        actions=[one.action for one in episodes.decisions(session, id)],
    )


def actions_file(episode: EpisodeDetail) -> str:
    """The name under which the actions are downloaded."""
    return f"{episode.task}-{episode.split}-{episode.index:03d}{ACTIONS_SUFFIX}"


def rerun(session: Session, id: str) -> RerunPublic:
    """The commands that play an episode again with its own policy.

    Raises:
        Problem: 404, there is no such episode.
    """
    episode = episodes.get(session, id)
    evaluation = evaluations.get(session, episode.evaluation)
    version = policies.public(session, policies.find(session, evaluation.policy_version))
    asked = Asked(episode, evaluation)
    return RerunPublic(
        command=asked.command(*policy_of(version, actions_file(episode))),
        replay=asked.command(f"replay:{actions_file(episode)}"),
        notes=list(needs_of(version)),
        scene_hash=episode.scene_hash,
        final_state_hash=episode.final_state_hash,
    )


class Asked:
    """Which episode `hide eval` is asked for."""

    def __init__(self, episode: EpisodeDetail, evaluation: EvaluationPublic):
        self.words = ["--tasks", episode.task, "--split", episode.split]
        self.words += ["--index", str(episode.index)]
        self.words += ["--rules", evaluation.rules] * (evaluation.rules != "hide")

    def command(self, policy: str, *more: str) -> str:
        """For a shell."""
        return shlex.join(["hide", "eval", policy, *self.words, *more])


def policy_of(version: PolicyVersionPublic, actions: str) -> Iterator[str]:
    """POLICY of the command line, and the options that it takes; a replay reads these actions."""
    spec = version.spec
    match spec:
        case BuiltInPolicy():
            yield spec.name
        case PythonPolicy():
            yield f"python:{spec.target}"
        case CheckpointPolicy():
            yield version.policy if _comes_along(version) else f"{version.policy}.safetensors"
        case RemotePolicy():
            yield spec.url
        case ReplayPolicy():
            yield f"replay:{actions}"
    if isinstance(spec, PythonPolicy | CheckpointPolicy) and spec.timeout != TIMEOUT:
        yield from ("--policy-timeout", f"{spec.timeout:g}")
    if isinstance(spec, RemotePolicy) and _declares(spec):
        yield from ("--maps", f"{version.policy}.toml")


def needs_of(version: PolicyVersionPublic) -> Iterator[str]:
    """What the command needs that this server cannot put into it."""
    spec = version.spec
    match spec:
        case PythonPolicy():
            yield "The class must be importable where the command runs."
        case CheckpointPolicy() if _comes_along(version):
            yield (
                f"{version.policy} comes with HIDE-SEEK; this is the release whose file has the "
                f"SHA-256 {spec.sha256}."
            )
        case CheckpointPolicy():
            yield (
                f"{version.policy}.safetensors is the file that was uploaded, SHA-256 "
                f"{spec.sha256}; the server does not give checkpoints out."
            )
        case RemotePolicy():
            yield "The policy must still be served at this address, and its key be known."
        case ReplayPolicy():
            yield "The file is this episode's actions, downloaded here."
    if isinstance(spec, RemotePolicy) and _declares(spec):
        yield (
            f"{version.policy}.toml declares what it sees and how it acts, as in "
            "docs/remote_policies.md; GET /api/v1/policies has both."
        )


def _comes_along(version: PolicyVersionPublic) -> bool:
    return version.owner is None and version.policy in trained.POLICIES


def _declares(spec: RemotePolicy) -> bool:
    return spec.observation is not None or spec.action is not None
