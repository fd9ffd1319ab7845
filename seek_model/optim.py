"""How weights move: LAMB, which parameters a phase trains, its learning rate, averaged weights."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import cos, pi
from typing import Any, Protocol, overload

import torch
from torch import Tensor
from torch.nn import Parameter

from seek_model.config import Phase

BIGGEST_NORM = 10.0  # of a weight, as the trust ratio counts it (You et al. 2020, appendix)


class Parted(Protocol):
    """A network that tells which of its parameters belong to which part."""

    def parts(self) -> Mapping[str, Iterable[Parameter]]: ...

    def named_parameters(self) -> Iterable[tuple[str, Parameter]]: ...


class Lamb(torch.optim.Optimizer):
    """LAMB: Adam's direction, as long as the weight that it changes.

    A weight of norm 0 is trusted by 1, so a tensor that starts at zero moves. Tensors of one
    dimension (biases, norms) take Adam's step without trust ratio and without decay.
    `corrected = False` leaves out the bias correction, as RVT's implementation does.

    Source: You et al. 2020, algorithm 2, with phi(z) = min(z, 10).
    """

    def __init__(
        self,
        parameters: Iterable[Parameter],
        lr: float = 1e-3,
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-6,
        weight_decay: float = 0.0,
        corrected: bool = True,
    ):
        defaults = {
            "lr": lr,
            "betas": betas,
            "eps": eps,
            "weight_decay": weight_decay,
            "corrected": corrected,
        }
        super().__init__(parameters, defaults)

    @overload
    def step(self, closure: None = None) -> None: ...

    @overload
    def step(self, closure: Callable[[], float]) -> float: ...

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:
        """Moves every parameter that has a gradient; returns what `closure` returns."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    self._move(parameter, group)
        return loss

    def _move(self, weight: Parameter, group: dict[str, Any]) -> None:
        update = self._direction(weight, group)
        if weight.ndim > 1:
            update = update.add(weight, alpha=group["weight_decay"])
            update = update * _trust(weight.norm(), update.norm())
        weight.sub_(update, alpha=group["lr"])

    def _direction(self, weight: Parameter, group: dict[str, Any]) -> Tensor:
        """Adam's, of learning rate 1."""
        assert weight.grad is not None
        state, (first, second) = self.state[weight], group["betas"]
        if not state:
            state.update(step=0, mean=torch.zeros_like(weight), square=torch.zeros_like(weight))
        state["step"] += 1
        mean = state["mean"].lerp_(weight.grad, 1 - first)
        square = state["square"].mul_(second).addcmul_(weight.grad, weight.grad, value=1 - second)
        if group["corrected"]:
            mean = mean / (1 - first ** state["step"])
            square = square / (1 - second ** state["step"])
        direction: Tensor = mean / square.sqrt().add(group["eps"])
        return direction


def _trust(weight: Tensor, update: Tensor) -> Tensor:
    """phi(||w||) / ||update||; 1 where either is 0."""
    ratio = weight.clamp(max=BIGGEST_NORM) / update
    return torch.where((weight > 0) & (update > 0), ratio, torch.ones_like(ratio))


class Optimizers:
    """Several optimisers that step as one, all at the same learning rate."""

    def __init__(self, optimizers: Sequence[torch.optim.Optimizer]):
        self.optimizers = optimizers

    def parameters(self) -> list[Parameter]:
        """Every parameter that is trained."""
        groups = [group for one in self.optimizers for group in one.param_groups]
        return [parameter for group in groups for parameter in group["params"]]

    def step(self, rate: float) -> None:
        """One update at this learning rate."""
        for one in self.optimizers:
            for group in one.param_groups:
                group["lr"] = rate
            one.step()

    def zero_grad(self) -> None:
        """Forgets the gradients."""
        for one in self.optimizers:
            one.zero_grad(set_to_none=True)

    def state_dict(self) -> list[dict[str, Any]]:
        """What `load_state_dict` of equal optimisers takes."""
        return [one.state_dict() for one in self.optimizers]

    def load_state_dict(self, states: Sequence[dict[str, Any]]) -> None:
        """Goes on where another left off."""
        for one, state in zip(self.optimizers, states, strict=True):
            one.load_state_dict(state)


def optimizer(network: Parted, phase: Phase) -> Optimizers:
    """Freezes what the phase freezes, and optimises the rest.

    With LAMB the LoRA parameters are Adam's (paper, table of hyperparameters, note †). Biases
    and norms are never decayed. Parameters that need no gradient before stay as they are.
    """
    freeze(network, phase)
    parts = network.parts()
    adapters = {id(parameter) for parameter in parts.get("lora", ())}
    trained = [parameter for _, parameter in network.named_parameters() if parameter.requires_grad]
    if phase.optimizer != "lamb":
        make = torch.optim.Adam if phase.optimizer == "adam" else torch.optim.AdamW
        return Optimizers([make(_groups(trained, phase.decay), lr=phase.rate)])
    others = [parameter for parameter in trained if id(parameter) not in adapters]
    lora = [parameter for parameter in trained if id(parameter) in adapters]
    made: list[torch.optim.Optimizer] = [Lamb(others, lr=phase.rate, weight_decay=phase.decay)]
    if lora:
        made.append(torch.optim.Adam(lora, lr=phase.rate))
    return Optimizers(made)


def _groups(parameters: Sequence[Parameter], decay: float) -> list[dict[str, Any]]:
    matrices = [parameter for parameter in parameters if parameter.ndim > 1]
    vectors = [parameter for parameter in parameters if parameter.ndim <= 1]
    groups = ({"params": matrices, "weight_decay": decay}, {"params": vectors, "weight_decay": 0.0})
    return [group for group in groups if group["params"]]


def freeze(network: Parted, phase: Phase) -> None:
    """Takes the gradient from what the phase leaves alone; nothing is thawed."""
    parts = network.parts()
    frozen: list[Parameter] = []
    if "encoder" in phase.freeze:
        frozen += [*parts["encoder"], *parts["lora"]]
    if "fine" in phase.freeze:
        frozen += parts["fine"]
    if "all_but_memory" in phase.freeze:  # SAM2Act+ trains the decoder of coarse heat maps as well
        kept = {id(one) for name in ("memory", "coarse_decoder") for one in parts[name]}
        frozen += [one for _, one in network.named_parameters() if id(one) not in kept]
    for parameter in frozen:
        parameter.requires_grad_(False)


def rate(step: int, phase: Phase) -> float:
    """The learning rate of a step, counted from 0.

    Linear until `warmup`, then a cosine that reaches `lowest * rate` at `horizon`, wherever
    training stops, and stays there.
    """
    if step < phase.warmup:
        return phase.rate * (step + 1) / phase.warmup
    gone = min((step - phase.warmup) / max(phase.horizon - phase.warmup, 1), 1.0)
    height = 0.5 * (1 + cos(pi * gone))
    return phase.rate * (phase.lowest + (1 - phase.lowest) * height)


@torch.no_grad()
def average(averaged: Mapping[str, Tensor], weights: Mapping[str, Tensor], share: float) -> None:
    """Moves averaged weights towards the present ones; `share` of the former stays.

    Whatever is not floating point (counts, bytes) is taken over as it is.
    """
    for name, present in weights.items():
        if present.is_floating_point():
            averaged[name].lerp_(present, 1 - share)
        else:
            averaged[name].copy_(present)


def average_share(step: int, share: float) -> float:
    """Of the former average at a step from 0: small at first, so the start is soon forgotten."""
    return min(share, (1 + step) / (10 + step))
