"""SEEK that is told the truth, to see what limits it: its counter, its anchor, or neither.

It looks into the world, so it plays in the simulator's process and stands on no leaderboard.
"""

from pathlib import Path
from typing import Literal, get_args

import torch

from hide_tasks.bullet.world import World
from hide_tasks.contract import EpisodeSpec, HiddenState, Keyframe, Observation
from hide_tasks.demos import evidence_of
from hide_tasks.stages import stages_done
from seek_model import checkpoint
from seek_model.config import Config
from seek_model.frames import Targets
from seek_model.network import Network
from seek_model.policy import SeekPolicy

Told = Literal["own", "true_counts", "true_anchors", "both"]
KINDS: tuple[Told, ...] = get_args(Told)


class ToldPolicy(SeekPolicy):
    """A policy of the contract that is told counts, anchors, or both.

    `true_counts`: before every decision the counter is set to how many stages are done in the
    world; where several numbers are right, to the one nearest its own. `true_anchors`: it looks
    back at the last decision that changed the hidden state, if that left the window, else at none.
    """

    def __init__(self, network: Network, config: Config, kind: Told):
        self.kind = kind
        super().__init__(network, config)

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        """Take the world to look into."""
        self.world, self.spec = world, spec

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Forget everything."""
        self._hidden: list[HiddenState] = []
        super().reset(instruction, policy_seed)

    def act(self, observation: Observation) -> Keyframe:
        """The next keyframe."""
        self._hidden.append(self.world.task.hidden_state())
        return super().act(observation)

    def told(self) -> Targets | None:
        """The truth, where it is told; of the rest what it believes."""
        if self.kind == "own" or self.config.model.memory is None:
            return None
        believed = self._archives[0].done
        done = believed if self.kind == "true_anchors" else self.true_count(believed)
        return _targets(done, int(evidence_of(self._hidden)[-1]))

    def true_count(self, believed: int) -> int:
        """Stages that are done; what is believed where no expert ever came."""
        stage, hidden = self.world.task.stage(), self._hidden[-1]
        known = stages_done(self.spec.task, self.spec.variation, stage, hidden)
        return min(known, key=lambda done: abs(done - believed), default=believed)


def load(path: Path, kind: Told) -> ToldPolicy:
    """The policy of a checkpoint that is told what `kind` says.

    Raises:
        BadCheckpoint: the first thing that is wrong with the file.
        OSError: it cannot be read.
    """
    network, config, _ = checkpoint.load(path)
    memory = config.model.memory
    if kind in ("true_anchors", "both") and memory and memory.anchor != "none":
        memory = memory.model_copy(update={"anchor": "oracle"})
        config = config.model_copy(
            update={"model": config.model.model_copy(update={"memory": memory})}
        )
        told = Network(config.model)  # an anchor is chosen without parameters
        checkpoint.fill(told, checkpoint.weights(network))
        network = told
    return ToldPolicy(network, config, kind)


def _targets(done: int, evidence: int) -> Targets:
    """Of one frame; whatever else a demonstration says is not read in play."""
    nothing, no = torch.zeros(1, 1), torch.zeros(1, 1, dtype=torch.long)
    return Targets(
        position=torch.zeros(1, 1, 3),
        rotation=torch.zeros(1, 1, 3, dtype=torch.long),
        opening=no,
        ignore_collisions=no,
        stage=torch.tensor([[done]]),
        boundary=nothing,
        stop=nothing,
        evidence=torch.tensor([[evidence]]),
        supervised=torch.ones(1, 1, dtype=torch.bool),
    )
