"""Checkpoints of small networks that were never trained."""

from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file

from seek_model import checkpoint
from seek_model.checkpoint_header import Provenance, read_header
from seek_model.config import Config
from seek_model.network import Network
from tests.seek_model.tiny import tiny


def tiny_checkpoint(
    path: Path, config: Config | None = None, seed: int = 0, suite: str = "hide"
) -> Path:
    """A checkpoint of random weights that plays like any other."""
    config = config or tiny()
    torch.manual_seed(seed)
    provenance = Provenance(
        project="0.1.0",
        torch=torch.__version__,
        suite=suite,
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


def parts_of(path: Path) -> dict[str, Any]:
    """What torch.save is given to write the checkpoint in a file."""
    header = read_header(path)
    return {
        "config": header.config.model_dump(mode="json"),
        "provenance": header.provenance.model_dump_json(),
        "weights": load_file(path),
    }
