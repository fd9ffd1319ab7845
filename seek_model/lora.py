"""LoRA on queries and values of SAM 2's image encoder (Hu et al. 2021).

SAM2Act adapts only the first channels of the three blocks that change the width, because it takes
the input's width for the output's. Here all channels of q and v are adapted.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from seek_model.hiera import Attention, ImageEncoder


class LoraQkv(nn.Linear):
    """The layer that makes queries, keys and values, with a low-rank addition to q and v.

    Its own weights keep their names, are frozen, and at first nothing is added.
    """

    def __init__(self, base: nn.Linear, rank: int):
        super().__init__(base.in_features, base.out_features, device="meta")
        self.weight, self.bias = base.weight, base.bias
        for parameter in self.parameters():
            parameter.requires_grad_(False)
        down, up = (rank, base.in_features), (base.out_features // 3, rank)
        self.q_down = nn.Parameter(base.weight.new_empty(down))
        self.q_up = nn.Parameter(base.weight.new_zeros(up))
        self.v_down = nn.Parameter(base.weight.new_empty(down))
        self.v_up = nn.Parameter(base.weight.new_zeros(up))
        for parameter in (self.q_down, self.v_down):
            nn.init.kaiming_uniform_(parameter, a=math.sqrt(5))

    def forward(self, input: Float[Tensor, "*b c"]) -> Float[Tensor, "*b c3"]:
        q, k, v = super().forward(input).chunk(3, dim=-1)
        linear = nn.functional.linear
        q = q + linear(linear(input, self.q_down), self.q_up)
        v = v + linear(linear(input, self.v_down), self.v_up)
        return torch.cat([q, k, v], dim=-1)

    def added(self) -> list[nn.Parameter]:
        """What is trained."""
        return [self.q_down, self.q_up, self.v_down, self.v_up]


def add_lora(encoder: ImageEncoder, rank: int) -> None:
    """Freeze the encoder and adapt every block of its trunk. Weights are loaded before this."""
    encoder.requires_grad_(False)
    for module in list(encoder.trunk.modules()):
        if isinstance(module, Attention):
            module.qkv = LoraQkv(module.qkv, rank)


def lora_parameters(module: nn.Module) -> list[nn.Parameter]:
    """All that LoRA added anywhere in `module`; nothing where there is none."""
    layers = (part for part in module.modules() if isinstance(part, LoraQkv))
    return [parameter for layer in layers for parameter in layer.added()]
