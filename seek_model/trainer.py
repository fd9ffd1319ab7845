"""One phase of training: a network, its average, and what moves them.

Dropout and noise are drawn from a generator that every update seeds anew, so nothing of it has to
be kept to go on.
"""

import copy
import hashlib
import math
from typing import Any

import torch
from torch import Tensor

from seek_model import checkpoint, losses, optim
from seek_model.config import Config, Model, Phase
from seek_model.distributed import Group
from seek_model.frames import Frames, Targets
from seek_model.network import Network
from seek_model.progress import PHASES
from seek_model.validation import Precision


class TrainingError(RuntimeError):
    """The training cannot begin, or not go on."""


class Trainer:
    """One phase: a network, its average, and what moves them.

    Args:
        name: of the phase.
        config: of the whole training.
        group: that trains together.
        before: the averaged weights that the first phase ended with.

    Raises:
        TrainingError: a pretrained part lacks its file, or it does not fit.
    """

    def __init__(self, name: str, config: Config, group: Group, before: dict[str, Tensor] | None):
        self.name, self.group = name, group
        self.config = config if name == PHASES[1] else _without_memory(config)
        self.phase: Phase = getattr(config.train, name)
        torch.manual_seed(_number(config.train.seed, name))
        self.network = _made(self.config.model).to(group.device)
        if before:
            _start_from(self.network, before)
        self.mean = copy.deepcopy(self.network).requires_grad_(False)
        self.weights = checkpoint.weights(self.network)
        self.averaged = checkpoint.weights(self.mean)
        self.optimizers = optim.optimizer(self.network, self.phase)
        self.moving = _moving(self.network, self.weights)
        # A memory that is still empty is not read with all of its parameters.
        unused = self.config.model.memory is not None
        self.parallel = group.parallel(self.network, unused=unused)
        self.step = 0

    def update(
        self, frames: Frames, targets: Targets, precision: Precision, stop: bool
    ) -> dict[str, float]:
        """One update; the group's mean losses, the gradient's norm, the rate, and `stopping`.

        `stopping` is above 0 if any process of the group was asked to stop.
        """
        train, phase = self.config.train, self.phase
        torch.manual_seed(_number(train.seed, self.name, self.step, self.group.rank))
        frames, targets = frames.to(self.group.device), targets.to(self.group.device)
        with precision.cast():
            predictions = self.parallel(
                frames,
                targets,
                zoom_noise=train.zoom_noise,
                zoom_draw=train.zoom_draw,
                coarse_only=phase.loss == "coarse",
            )
        found = losses.total(predictions, targets, self.network, train, phase)
        self.optimizers.zero_grad()
        torch.autograd.backward(found["total"])
        norm = torch.nn.utils.clip_grad_norm_(self.optimizers.parameters(), phase.clip or math.inf)
        rate = optim.rate(self.step, phase)
        self.optimizers.step(rate)
        optim.average(self.averaged, self.moving, optim.average_share(self.step, train.ema))
        self.step += 1
        told = found | {"gradient": norm, "stopping": norm.new_tensor(float(stop))}
        mean = self.group.mean(torch.stack([value.detach().float() for value in told.values()]))
        return dict(zip(told, mean.tolist(), strict=True)) | {"rate": rate}

    def state(self) -> dict[str, Any]:
        """What `restore` goes on from."""
        return {
            "phase": self.name,
            "step": self.step,
            "weights": self.weights,
            "averaged": self.averaged,
            "optimizers": self.optimizers.state_dict(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Stands where the trainer of `state` stood."""
        checkpoint.fill(self.network, state["weights"])
        checkpoint.fill(self.mean, state["averaged"])
        self.optimizers.load_state_dict(state["optimizers"])
        self.step = state["step"]


def _made(model: Model) -> Network:
    try:
        network = Network(model)
        network.language(["reads"])  # with the files of a pretrained reader, or not at all
    except (ValueError, FileNotFoundError) as error:
        raise TrainingError(f"The network cannot be made: {error}") from None
    return network


def _moving(network: Network, weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The weights that training changes: bytes are the file of a frozen reader's tokenizer."""
    frozen = {name for name, one in network.named_parameters() if not one.requires_grad}
    return {
        name: one
        for name, one in weights.items()
        if name not in frozen and one.dtype != torch.uint8
    }


def _without_memory(config: Config) -> Config:
    return config.model_copy(update={"model": config.model.model_copy(update={"memory": None})})


def _start_from(network: Network, before: dict[str, Tensor]) -> None:
    """Takes over the memory-free policy; its say that it is done did not know of stages."""
    if network.coarse.memory is None:
        return checkpoint.fill(network, before)
    known = {name: one for name, one in before.items() if not name.startswith("coarse.stop.")}
    checkpoint.fill(network, known, may_miss=("coarse.memory.", "coarse.stop."))


def _number(*parts: object) -> int:
    """A seed that these parts alone decide."""
    text = "/".join(map(str, parts))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "big")
