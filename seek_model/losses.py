"""L = L_act + lambda_stage L_stage (paper 4.4), and the stop's loss where there is one."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy

from seek_model import heatmaps
from seek_model.config import Phase, Train
from seek_model.frames import Targets
from seek_model.network import Network, Predictions

RAREST = 0.02  # share of positives that a weight still makes up for


def total(
    predictions: Predictions, targets: Targets, network: Network, train: Train, phase: Phase
) -> dict[str, Tensor]:
    """Each loss by name, and their sum, `total`.

    Translation is the mean over the views of both looks; the other parts of the action count
    once each (models.md 1.8). A phase whose loss is `coarse` trains what the coarse branch says:
    the target, where stages end, and when to stop. Keyframes that begin a stage weigh
    `choice_weight` times as much in the translation as others.
    """
    true = targets.at(predictions.rows.sequence, predictions.rows.step)
    weights = 1.0 + (phase.choice_weight - 1.0) * _begins(predictions, targets)
    found = _where(predictions, true, network, weights / weights.mean())
    if phase.loss == "all" and predictions.said is not None:
        rotation = predictions.said.rotation.float()
        for axis, name in enumerate(("rotation_x", "rotation_y", "rotation_z")):
            found[name] = cross_entropy(rotation[:, axis], true.rotation[:, axis])
        found["opening"] = cross_entropy(predictions.said.opening.float(), true.opening)
        collisions = predictions.said.ignore_collisions.float()
        found["collisions"] = cross_entropy(collisions, true.ignore_collisions)
    factors = {"boundary": train.stage_weight, "stop": train.stop_weight}
    if predictions.coarse.boundary is not None:
        found["boundary"] = _rare(predictions.coarse.boundary, true.boundary)
    if predictions.coarse.stop is not None:
        # Unweighted: a stop too early costs the episode, one too late a decision.
        stop = predictions.coarse.stop.float()
        found["stop"] = binary_cross_entropy_with_logits(stop, true.stop)
    found["total"] = torch.stack(
        [factors.get(name, 1.0) * loss for name, loss in found.items()]
    ).sum()
    return found


def _begins(predictions: Predictions, targets: Targets) -> Float[Tensor, " f"]:
    """1 where a stage begins: what comes next is told by memory, within a stage by the picture.

    The first frame of a sequence counts as one: of an episode, if its archive is a whole prefix.
    """
    rows = predictions.rows
    before = targets.boundary[rows.sequence, (rows.step - 1).clamp(min=0)]
    return torch.where(rows.step == 0, torch.ones_like(before), before)


def _where(
    predictions: Predictions, true: Targets, network: Network, weights: Float[Tensor, " f"]
) -> dict[str, Tensor]:
    cameras = network.coarse.cameras
    wanted = heatmaps.target(cameras.project(true.position), cameras.size)
    coarse = heatmaps.loss(predictions.coarse.decoded.logits.float(), wanted)
    coarse = (weights * coarse).mean()
    if predictions.fine is None or network.fine is None:
        return {"translation": coarse}
    near = network.fine.zoom * (true.position - predictions.fine.center)
    wanted = heatmaps.target(cameras.project(near), cameras.size)
    fine = heatmaps.loss(predictions.fine.logits.float(), wanted)
    fine = (weights * fine).mean()
    return {"translation": (coarse + fine) / 2}


def _rare(logits: Float[Tensor, " f"], true: Float[Tensor, " f"]) -> Tensor:
    """Cross-entropy in which the positives together weigh as much as the negatives."""
    share = true.mean().clamp(RAREST, 1 - RAREST)
    return binary_cross_entropy_with_logits(logits.float(), true, pos_weight=(1 - share) / share)
