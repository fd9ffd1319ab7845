"""The folder of one training: what it is of, where it stands, and what came out.

`config.json` says of what; `state.pt` is where it goes on, replaced whole, so a training that is
killed at any moment loses what came after its last save and nothing else.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from seek_model.checkpoint import PART, written
from seek_model.config import Config

ABOUT = "config.json"
STATE = "state.pt"
CHECKPOINT = "checkpoint.safetensors"
CHECKPOINT_FIRST = "checkpoint-first.safetensors"
LOCK = ".lock"
OURS = {LOCK, ABOUT + PART}  # of a training that was killed before it began


class TrainingFolderError(ValueError):
    """The folder cannot take this training; nothing in it was touched."""


@contextmanager
def opened(path: Path, config: Config, data: dict[str, Any], resume: bool) -> Iterator[None]:
    """Holds a folder for this training: a new one, or one that holds the same.

    Args:
        path: of the folder.
        config: of the training.
        data: what the demonstrations are.
        resume: whether a training that is there goes on.

    Raises:
        TrainingFolderError: it holds something else, another training, or, without `resume`, any;
            or another process has it.
    """
    about = {"config": config.model_dump(mode="json"), "data": data}
    _examine(path, about, resume)
    path.mkdir(parents=True, exist_ok=True)
    lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise TrainingFolderError(f"{path} is in use by another training") from None
        with written(path / ABOUT) as part:
            part.write_text(json.dumps(about, indent=1) + "\n")
        yield
    finally:
        os.close(lock)


def _examine(path: Path, about: dict[str, Any], resume: bool) -> None:
    if not path.exists() or (path.is_dir() and {one.name for one in path.iterdir()} <= OURS):
        return
    try:
        found = json.loads((path / ABOUT).read_text())
    except (OSError, ValueError):
        raise TrainingFolderError(
            f"{path} holds something that is no training (no {ABOUT}); choose another folder"
        ) from None
    if not resume:
        raise TrainingFolderError(f"{path} holds a training; choose another folder, or resume it")
    wanted = json.loads(json.dumps(about))
    if found != wanted:
        raise TrainingFolderError(
            f"{path} holds another training: {_difference(found, wanted)}; choose another folder"
        )


def _difference(found: Any, wanted: Any, place: str = "") -> str:
    """The first key whose value differs."""
    if not isinstance(found, dict) or not isinstance(wanted, dict):
        return f"{place} is {found!r:.80} there and {wanted!r:.80} here"
    keys = [key for key in {**wanted, **found} if found.get(key) != wanted.get(key)]
    key = keys[0] if keys else next(iter(set(found) ^ set(wanted)))
    return _difference(found.get(key), wanted.get(key), f"{place}.{key}".removeprefix("."))


def keep(path: Path, state: dict[str, Any]) -> None:
    """Writes where the training stands."""
    with written(path / STATE) as part:
        torch.save(state, part)


def kept(path: Path, device: torch.device) -> dict[str, Any] | None:
    """Where the training stands; None if it never saved. Nothing but tensors is unpickled.

    Raises:
        TrainingFolderError: the file is damaged.
    """
    if not (path / STATE).exists():
        return None
    try:
        state = torch.load(path / STATE, map_location=device, weights_only=True)
    except Exception as error:  # torch raises whatever zip, pickle or storage meet first
        raise TrainingFolderError(f"{path / STATE} cannot be read: {error}") from None
    return dict(state)
