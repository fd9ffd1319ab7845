import dataclasses
import math

import pytest
import torch

from seek_model import heatmaps, losses
from seek_model.config import Phase, Train
from seek_model.network import Network
from tests.seek_model.tiny import frames, targets, tiny_model

TRAIN = Train()
PHASE = Phase(steps=1, horizon=1, warmup=0, batch=2)


def network() -> Network:
    torch.manual_seed(0)
    return Network(tiny_model(stop=True))


def test_an_untrained_network_is_about_as_wrong_as_chance() -> None:
    net, seen = network(), frames(4, 3)
    wanted = targets(seen)

    found = losses.total(net(seen, wanted), wanted, net, TRAIN, PHASE)

    assert float(found["translation"].detach()) == pytest.approx(math.log(16**2), rel=0.2)
    for axis in "xyz":
        assert float(found[f"rotation_{axis}"].detach()) == pytest.approx(math.log(72), rel=0.1)


def test_the_total_is_the_sum_of_all_with_the_boundary_weighed() -> None:
    net, seen = network(), frames(2, 2)
    wanted = targets(seen)
    predictions = net(seen, wanted)

    once = losses.total(predictions, wanted, net, TRAIN, PHASE)
    thrice = losses.total(
        predictions, wanted, net, TRAIN.model_copy(update={"stage_weight": 3.0}), PHASE
    )

    parts = [value for name, value in once.items() if name != "total"]
    assert torch.allclose(once["total"], torch.stack(parts).sum())
    assert torch.allclose(thrice["total"] - once["total"], 2 * once["boundary"])


def test_keyframes_that_begin_a_stage_weigh_more_in_the_translation() -> None:
    """The first of an episode does, and those after a boundary."""
    net, seen = network(), frames(1, 4)
    wanted = dataclasses.replace(targets(seen), boundary=torch.tensor([[0.0, 1.0, 0.0, 0.0]]))
    predictions = net(seen, wanted, coarse_only=True)
    cameras = net.coarse.cameras
    each = heatmaps.loss(
        predictions.coarse.decoded.logits.float(),
        heatmaps.target(cameras.project(wanted.position[0]), cameras.size),
    )
    phase = PHASE.model_copy(update={"loss": "coarse", "choice_weight": 3.0})

    found = losses.total(predictions, wanted, net, TRAIN, phase)["translation"]

    expected = torch.tensor([3.0, 1.0, 3.0, 1.0]) @ each / 8
    assert torch.allclose(found, expected)


def test_a_coarse_phase_trains_what_the_coarse_branch_says() -> None:
    net, seen = network(), frames(2, 2)
    wanted = targets(seen)
    coarse = PHASE.model_copy(update={"loss": "coarse"})

    found = losses.total(net(seen, wanted, coarse_only=True), wanted, net, TRAIN, coarse)

    assert set(found) == {"translation", "boundary", "stop", "total"}


def test_the_fine_map_is_judged_about_its_own_center() -> None:
    net, seen = network(), frames(1, 1)
    wanted = dataclasses.replace(targets(seen), position=torch.tensor([[[0.1, -0.2, 0.3]]]))
    predictions = net(seen, wanted, zoom_noise=0.0)
    assert predictions.fine
    sure = torch.full_like(predictions.fine.logits, -50.0)
    sure[:, :, 7:9, 7:9] = 50.0  # the target is the center of an undisturbed look

    perfect = predictions._replace(fine=predictions.fine._replace(logits=sure))

    better = losses.total(perfect, wanted, net, TRAIN, PHASE)["translation"]
    worse = losses.total(
        perfect._replace(fine=perfect.fine._replace(logits=sure.roll(5, -1))),  # type: ignore[union-attr]
        wanted, net, TRAIN, PHASE,
    )["translation"]  # fmt: skip
    assert better < worse


def test_rare_boundaries_weigh_as_much_as_all_others() -> None:
    logits, rare = torch.zeros(10), torch.tensor([1.0] + [0.0] * 9)
    logits.requires_grad_()

    losses._rare(logits, rare).backward()

    assert logits.grad is not None
    assert float(logits.grad[0]) == pytest.approx(-float(logits.grad[1:].sum()))
