"""What the second phase goes on from, when a checkpoint of another training gives it."""

import hashlib
from pathlib import Path

import torch
from torch import Tensor

from seek_model import checkpoint
from seek_model.branch import CLOCK
from seek_model.checkpoint_header import BadCheckpoint
from seek_model.config import Config, ConvFilm, Model
from seek_model.trainer import TrainingError

TOLD = ".film.weight"  # ends the names of layers that are told words, fingers, and last the clock


def started(path: Path, config: Config) -> tuple[dict[str, Tensor], str]:
    """The weights of a memory-free checkpoint that the second phase goes on from; its SHA-256.

    A small policy that is told the clock may go on from one that is not: it begins as that policy,
    for it does not listen to the clock yet.

    Raises:
        TrainingError: it cannot be used, or is of another model.
    """
    try:
        network, there, _ = checkpoint.load(path)
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    except (BadCheckpoint, OSError) as error:
        raise TrainingError(f"train.start = {path} cannot be used: {error}") from None
    wanted, found = (checkpoint.self_contained(one.model) for one in (config, there))
    wanted = wanted.model_copy(update={"memory": None})
    clocked = _lacks_clock(found, wanted)
    _require_same(path, found, wanted.model_copy(update={"clock": False}) if clocked else wanted)
    weights = checkpoint.weights(network)
    return (_told_clock(weights) if clocked else weights), sha256


def _lacks_clock(found: Model, wanted: Model) -> bool:
    return wanted.clock and not found.clock and isinstance(wanted.backbone, ConvFilm)


def _require_same(path: Path, found: Model, wanted: Model) -> None:
    expected = wanted.model_dump()
    for key, value in found.model_dump().items():
        if value != expected[key]:
            raise TrainingError(
                f"train.start = {path} has model.{key} = {value}; expected {expected[key]}"
            )


def _told_clock(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The same with a column of zeros for the clock."""
    return {
        name: torch.nn.functional.pad(one, (0, CLOCK)) if name.endswith(TOLD) else one
        for name, one in weights.items()
    }
