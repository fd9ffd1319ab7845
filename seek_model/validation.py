"""What a network says on whole episodes that it was not trained on.

The demonstration is followed, whatever the network says: each frame is the demonstration's. Memory
is written with the network's own heat maps. Stages are counted by the demonstration, and once more
by the network itself, which shows what one missed boundary does to all later counts.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from seek_model import rotations
from seek_model.clouds import SCALE
from seek_model.config import Train
from seek_model.frames import Frames, Targets
from seek_model.network import Network, Predictions
from seek_model.sampling import Batch, Cut, assembled
from seek_model.store import Store

NEAR = 2.0  # cm that count as a hit
TURNED = 10.0  # degrees within which a rotation is right; its bins are of 5
DIGITS = 4

Arrays = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Precision:
    """Where and how a network calculates."""

    device: torch.device
    bf16: bool

    def cast(self) -> torch.autocast:
        """A context in which layers calculate so."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)


def whole_episodes(store: Store, settings: Train) -> dict[str, list[Batch]]:
    """The episodes of split val to validate on, as they were recorded; a batch for each task.

    Tasks without any are left out.
    """
    found = {}
    for task in settings.tasks or store.tasks:
        if episodes := store.episodes(task, "val")[: settings.validate_episodes]:
            part, longest = store.part(task, "val"), max(one.keyframes for one in episodes)
            cuts = [Cut(part, one, 0, 0, one.keyframes) for one in episodes]
            found[task] = [assembled(cuts, 0, longest)]
    return found


@torch.no_grad()
def validate(
    network: Network,
    episodes: Mapping[str, Iterable[Batch]],
    precision: Precision,
) -> dict[str, Any]:
    """How near the network comes, by task and over all frames.

    Args:
        network: it is left as it was.
        episodes: of each task, as `whole_episodes` gives them.
        precision: of the network.

    Returns:
        `tasks`, by name, and `overall`, each with `frames` (their number), `position_cm` (the
        median), `position_near` (share under 2 cm), `coarse_near` (of the coarse branch alone),
        `rotation_degrees` (the median, between bins), `opening`, `collisions` (shares that are
        right), `keyframe` (share under 2 cm and 10 degrees whose opening is right),
        `boundary_precision`, `boundary_recall`, `stop` (share that is right), and with the
        network's own counts `own_count` (share of frames at which they are right), `own_near`
        and `own_keyframe`. None where there is nothing to count.
    """
    training = network.training
    network.eval()
    found = {task: _joined(_measured(network, *one, precision) for one in each)
             for task, each in episodes.items()}  # fmt: skip
    network.train(training)
    return {
        "overall": summary(_joined(found.values())),
        "tasks": {task: summary(arrays) for task, arrays in found.items()},
    }


def _measured(network: Network, frames: Frames, targets: Targets, precision: Precision) -> Arrays:
    """What is measured of each frame, and of some frames only, as flat arrays."""
    frames, targets = frames.to(precision.device), targets.to(precision.device)
    found = _compared(_followed(network, frames, targets, targets, precision), network)
    if network.coarse.memory is not None and network.coarse.memory.boundary is not None:
        own = _compared(_followed(network, frames, targets, None, precision), network)
        found |= {f"own_{name}": own[name] for name in ("count", "error", "keyframe")}
    found.pop("count", None)
    return found


Said = list[tuple[Predictions, Targets]]


def _followed(
    network: Network,
    frames: Frames,
    targets: Targets,
    teacher: Targets | None,
    precision: Precision,
) -> Said:
    """What is said at each step, with the truth of the same rows."""
    archives = network.begin(frames.shape[0])
    said: Said = []
    # Without a memory no step waits for another.
    length = 1 if network.coarse.memory is not None else frames.shape[1]
    for step in range(0, frames.shape[1], length):
        now = frames.between(step, step + length)
        told = teacher.between(step, step + length) if teacher else None
        with precision.cast():
            predictions, pending = network.play(now, archives, told)
        if pending:
            pending.commit()
        rows = predictions.rows
        said.append((predictions, targets.at(rows.sequence, rows.step + step)))
    return said


def _compared(said: Said, network: Network) -> Arrays:
    counts = network.coarse.memory is not None
    return _joined(differences(predictions, true, counts) for predictions, true in said)


def differences(predictions: Predictions, true: Targets, counts: bool) -> Arrays:
    """How frames differ from the truth of the same rows, by the names of a summary's parts.

    Errors are in cm; `count` tells where the count of stages is right, if `counts`.
    """
    said, coarse, place = predictions.said, predictions.coarse, predictions.position
    assert said is not None
    assert place is not None
    found = {"count": (coarse.done == true.stage) if counts else None}
    for name, where in (("error", place), ("coarse_error", coarse.target)):
        found[name] = (where - true.position).norm(dim=-1) * (100 / SCALE)
    found["opening"] = said.opening.argmax(dim=-1) == true.opening
    found["collisions"] = said.ignore_collisions.argmax(dim=-1) == true.ignore_collisions
    if coarse.boundary is not None:
        says, ends = coarse.boundary > 0, true.boundary > 0
        found["boundary_precision"], found["boundary_recall"] = ends[says], says[ends]
    if coarse.stop is not None:
        found["stop"] = (coarse.stop > 0) == (true.stop > 0)
    arrays = {name: _array(value) for name, value in found.items() if value is not None}
    bins = [_array(one).astype(np.int64) for one in (said.rotation.argmax(dim=-1), true.rotation)]
    arrays["rotation"] = rotations.angle_between(*map(rotations.decode, bins))
    near, right = arrays["error"] < NEAR, arrays["opening"] > 0
    arrays["keyframe"] = (near & (arrays["rotation"] < TURNED) & right).astype(np.float64)
    return arrays


def _array(values: Tensor) -> NDArray[np.float64]:
    return values.double().cpu().numpy()


def _joined(parts: Iterable[Arrays]) -> Arrays:
    listed = list(parts)
    names = dict.fromkeys(name for part in listed for name in part)
    return {name: np.concatenate([p[name] for p in listed if name in p]) for name in names}


def summary(found: Arrays) -> dict[str, float | int | None]:
    """Differences in a few numbers, as `validate` returns them."""

    def mean(name: str) -> float | None:
        values = found.get(name, np.zeros(0))
        return round(float(values.mean()), DIGITS) if len(values) else None

    def median(name: str) -> float | None:
        values = found.get(name, np.zeros(0))
        return round(float(np.median(values)), DIGITS) if len(values) else None

    def near(name: str) -> float | None:
        values = found.get(name, np.zeros(0))
        return round(float((values < NEAR).mean()), DIGITS) if len(values) else None

    shares = (
        "opening", "collisions", "keyframe", "boundary_precision", "boundary_recall", "stop",
        "own_count", "own_keyframe",
    )  # fmt: skip
    return {
        "frames": len(found.get("error", ())),
        "position_cm": median("error"),
        "position_near": near("error"),
        "coarse_near": near("coarse_error"),
        "rotation_degrees": median("rotation"),
        **{name: mean(name) for name in shares},
        "own_near": near("own_error"),
    }
