"""LAMB against the paper's formulas, frozen parts, the schedule and averaged weights."""

from collections.abc import Iterable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn
from torch.nn import Parameter

from seek_model import optim
from seek_model.config import Phase
from seek_model.optim import Lamb


def phase(**changes: object) -> Phase:
    return Phase.model_validate({"steps": 10, "horizon": 100, "warmup": 10, "batch": 2} | changes)


class Parts(nn.Module):
    """Parts named as the network's."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.encoder = nn.Linear(3, 3)
        self.adapter = Parameter(torch.zeros(3, 2))
        self.memory = nn.Linear(3, 3)
        self.coarse = nn.ModuleDict({"trunk": nn.Linear(3, 3), "decoder": nn.Linear(3, 3)})
        self.fine = nn.Linear(3, 3)

    def parts(self) -> dict[str, Iterable[Parameter]]:
        return {
            "encoder": list(self.encoder.parameters()),
            "lora": [self.adapter],
            "memory": list(self.memory.parameters()),
            "coarse": list(self.coarse["trunk"].parameters()),
            "coarse_decoder": list(self.coarse["decoder"].parameters()),
            "fine": list(self.fine.parameters()),
            "language": [],
        }

    def trained(self) -> set[str]:
        return {name for name, one in self.named_parameters() if one.requires_grad}


def moved(weight: Tensor, gradients: list[Tensor], **settings: object) -> Tensor:
    """A weight after one LAMB step for each gradient."""
    parameter = Parameter(weight.clone())
    lamb = Lamb([parameter], **settings)  # type: ignore[arg-type]
    for gradient in gradients:
        parameter.grad = gradient.clone()
        lamb.step()
    return parameter.detach()


def by_the_paper(weight: Tensor, gradients: list[Tensor], lr: float, decay: float) -> Tensor:
    """You et al. 2020, algorithm 2, line by line, in double precision."""
    x, m, v = weight.double(), torch.zeros_like(weight).double(), torch.zeros_like(weight).double()
    for t, gradient in enumerate(gradients, start=1):
        m = 0.9 * m + 0.1 * gradient
        v = 0.999 * v + 0.001 * gradient**2
        r = (m / (1 - 0.9**t)) / ((v / (1 - 0.999**t)).sqrt() + 1e-6)
        update = r + decay * x
        x = x - lr * min(float(x.norm()), 10.0) / float(update.norm()) * update
    return x.float()


@pytest.mark.parametrize("size", [0.1, 1.0, 100.0])
def test_lamb_takes_the_steps_of_the_paper(size: float) -> None:
    torch.manual_seed(0)
    weight, gradients = size * torch.randn(4, 3), [torch.randn(4, 3) for _ in range(5)]

    result = moved(weight, gradients, lr=0.01, weight_decay=0.1)

    torch.testing.assert_close(result, by_the_paper(weight, gradients, 0.01, 0.1))


def test_a_tensor_of_zeros_moves() -> None:
    result = moved(torch.zeros(2, 2), [torch.ones(2, 2)], lr=0.01)

    torch.testing.assert_close(result, torch.full((2, 2), -0.01), rtol=1e-4, atol=0)


def test_without_a_gradient_the_weight_stays() -> None:
    weight = torch.ones(2, 2)

    assert torch.equal(moved(weight, [torch.zeros(2, 2)], lr=0.01), weight)


def test_a_bias_takes_adams_step_whatever_its_size_and_is_not_decayed() -> None:
    small, large = torch.full((3,), 1e-3), torch.full((3,), 50.0)
    gradient = torch.ones(3)

    steps = [moved(w, [gradient], lr=0.01, weight_decay=0.5) - w for w in (small, large)]

    torch.testing.assert_close(steps[0], torch.full((3,), -0.01), rtol=1e-3, atol=0)
    torch.testing.assert_close(steps[0], steps[1], rtol=1e-3, atol=0)


def test_without_the_correction_the_first_step_of_a_bias_is_the_raw_moments() -> None:
    step = moved(torch.zeros(1), [torch.ones(1)], lr=1.0, corrected=False)

    torch.testing.assert_close(step, torch.tensor([-0.1 / (0.001**0.5 + 1e-6)]))


def test_the_trust_ratio_ignores_how_large_gradients_are() -> None:
    torch.manual_seed(0)
    weight, gradient = torch.randn(3, 3), torch.randn(3, 3)

    small, large = (moved(weight, [scale * gradient], lr=0.01) for scale in (1.0, 1000.0))

    torch.testing.assert_close(small, large, rtol=1e-3, atol=1e-6)


def test_lora_is_adams_and_all_else_is_lambs() -> None:
    network = Parts()

    optimizers = optim.optimizer(network, phase(optimizer="lamb", decay=1e-4)).optimizers

    lamb, adam = optimizers
    assert isinstance(lamb, Lamb)
    assert isinstance(adam, torch.optim.Adam)
    assert adam.param_groups[0]["params"] == [network.adapter]
    assert all(one is not network.adapter for one in lamb.param_groups[0]["params"])
    assert adam.param_groups[0]["weight_decay"] == 0.0


@pytest.mark.parametrize("kind", ["adam", "adamw"])
def test_biases_are_not_decayed(kind: str) -> None:
    groups = optim.optimizer(Parts(), phase(optimizer=kind, decay=0.1)).optimizers[0].param_groups

    decays = {group["weight_decay"]: {one.ndim for one in group["params"]} for group in groups}
    assert decays == {0.1: {2}, 0.0: {1}}


@pytest.mark.parametrize(
    ("freeze", "left"),
    [
        ([], {"encoder", "adapter", "memory", "coarse", "fine"}),
        (["encoder"], {"memory", "coarse", "fine"}),
        (["fine"], {"encoder", "adapter", "memory", "coarse"}),
        (["all_but_memory"], {"memory", "coarse"}),
    ],
)
def test_a_frozen_part_is_not_trained(freeze: list[str], left: set[str]) -> None:
    network = Parts()

    trained = optim.optimizer(network, phase(freeze=freeze)).parameters()

    assert {name.split(".")[0] for name in network.trained()} == left
    assert len(trained) == len(network.trained())


def test_of_the_coarse_branch_sam2act_plus_trains_the_decoder() -> None:
    network = Parts()

    optim.freeze(network, phase(freeze=["all_but_memory"]))

    assert {name for name in network.trained() if name.startswith("coarse")} == {
        "coarse.decoder.weight",
        "coarse.decoder.bias",
    }


def test_optimisers_go_on_where_others_left_off() -> None:
    def train(optimizers: optim.Optimizers, steps: range) -> None:
        for step in steps:
            torch.manual_seed(step)
            for parameter in optimizers.parameters():
                parameter.grad = torch.randn_like(parameter)
            optimizers.step(0.01)

    settings = phase(optimizer="lamb", decay=1e-2)
    whole, first, second = Parts(), Parts(), Parts()
    train(optim.optimizer(whole, settings), range(6))
    optimizers = optim.optimizer(first, settings)
    train(optimizers, range(3))

    second.load_state_dict(first.state_dict())
    resumed = optim.optimizer(second, settings)
    resumed.load_state_dict(optimizers.state_dict())
    train(resumed, range(3, 6))

    for one, other in zip(whole.parameters(), second.parameters(), strict=True):
        assert torch.equal(one, other)


def test_the_rate_rises_to_its_peak_and_falls_to_its_lowest() -> None:
    settings = phase(rate=1.0, lowest=0.1, warmup=10, horizon=100)

    assert optim.rate(0, settings) == pytest.approx(0.1)
    assert optim.rate(9, settings) == optim.rate(10, settings) == 1.0
    assert optim.rate(55, settings) == pytest.approx(0.55)
    assert optim.rate(100, settings) == optim.rate(10_000, settings) == pytest.approx(0.1)


@settings(max_examples=50)
@given(st.integers(0, 300), st.integers(0, 50), st.integers(1, 200), st.floats(0.0, 1.0))
def test_the_rate_lies_in_its_bounds_and_does_not_know_where_training_stops(
    step: int, warmup: int, horizon: int, lowest: float
) -> None:
    early, late = (
        phase(rate=2.0, lowest=lowest, warmup=warmup, horizon=horizon, steps=steps)
        for steps in (1, 500)
    )

    rate = optim.rate(step, early)

    assert rate == optim.rate(step, late)
    assert 0 <= rate <= 2.0 + 1e-9
    assert step < warmup or rate >= 2.0 * lowest - 1e-9


def test_an_average_moves_by_its_share_and_counts_are_taken_over() -> None:
    averaged = {"weight": torch.tensor([0.0]), "count": torch.tensor(3)}

    optim.average(averaged, {"weight": torch.tensor([1.0]), "count": torch.tensor(4)}, share=0.75)

    assert averaged["weight"].item() == 0.25
    assert averaged["count"].item() == 4


def test_the_start_is_soon_forgotten() -> None:
    shares = [optim.average_share(step, 0.999) for step in (0, 10, 100_000)]

    assert shares == [0.1, 0.55, 0.999]
