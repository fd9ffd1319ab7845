"""Checkpoints of small networks that were never trained."""

from pathlib import Path

import torch

from seek_model import checkpoint
from seek_model.checkpoint_header import Provenance
from seek_model.config import Config
from seek_model.network import Network
from tests.seek_model.tiny import tiny


def tiny_checkpoint(path: Path, config: Config | None = None, seed: int = 0) -> Path:
    """A checkpoint of random weights that plays like any other."""
    config = config or tiny()
    torch.manual_seed(seed)
    provenance = Provenance(
        project="0.1.0",
        torch=torch.__version__,
        suite="hide",
        version=1,
        data="0" * 64,
        tasks=("push_button_times",),
        phase="second",
        step=0,
        seed=seed,
        seconds=0.0,
    )
    checkpoint.save(path, checkpoint.weights(Network(config.model)), config, provenance)
    return path
