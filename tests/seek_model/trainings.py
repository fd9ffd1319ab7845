"""The smallest training that has all parts, also as a program that can be killed."""

import sys
from pathlib import Path
from typing import Any

import torch

from seek_model.config import Config, ConvFilm, Language, Memory, Model, Phase, Train, Views
from seek_model.store import Store
from tests.seek_model import stores

VIEWS = Views(size=16, points=100, voxel=0.05)


def tiny(**train: Any) -> Config:
    """Two phases of a few steps; `train` changes fields of its `Train`."""
    model = Model(
        views=VIEWS,
        backbone=ConvFilm(widths=(8, 16), channels=16, depth=1, heads=2),
        language=Language(channels=16, tokens=8),
        memory=Memory(channels=8, layers=1, feedforward=16, gate=True),
        stop=True,
    )
    settings = {
        "first": Phase(steps=2, horizon=8, warmup=2, batch=2),
        "second": Phase(steps=3, horizon=8, warmup=2, batch=2, frames=3),
        "precision": "fp32",
        "validate_every": 100,
        "validate_episodes": 2,
        "save_every": 1000.0,
    }
    return Config(name="tiny", model=model, train=Train.model_validate(settings | train))


def tiny_store(path: Path) -> Store:
    """Two tasks; one episode is longer than the window of memory, one shorter than a sequence."""
    counts = {("press", "train"): [10, 2], ("lift", "train"): [5]}
    return stores.store(path, counts | {("press", "val"): [4, 9], ("lift", "val"): [3]})


def main(mode: str, store: str, out: str, save_every: str) -> None:
    """Trains as `train` does. With `ranks` every process writes its weights to `out` as well."""
    from seek_model import checkpoint, training
    from seek_model.progress import Watcher

    config = tiny(save_every=float(save_every), precision="bf16" if mode == "ranks" else "fp32")
    if mode == "train":
        training.train(config, Path(store), Path(out))
        return
    with training.prepared(config, Path(store), Path(out), True, Watcher()) as run:
        run.train()
        weights = checkpoint.weights(run.trainer.network)
        torch.save(weights, Path(out, f"rank-{run.group.rank}.pt"))


if __name__ == "__main__":
    main(*sys.argv[1:])
