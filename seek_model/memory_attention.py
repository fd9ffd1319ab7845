"""Present features look at memory (paper equation 2, as in SAM 2's memory attention).

e episodes, v views, n = h*w cells, d channels of features, c of memory, m keys. Views are read
apart from each other: a view attends to its own entries. The virtual views hang in a fixed frame
of the world, so the same cell is the same place: the code of a place is the same for queries and
keys (models.md D1), and turns with the difference (RoPE).
"""

import math
from typing import NamedTuple

import torch
from einops import rearrange, repeat
from jaxtyping import Complex, Float
from torch import Tensor, nn

from seek_model import config
from seek_model.attention import weigh
from seek_model.memory import Slots

BASE = 10_000.0  # of the wavelengths, as in RoPE and SAM 2
CODE_SCALE = 0.5  # of the codes of age at first; from SAM 2's 0.02 ages are told apart much later
POSITION_SHARE = 0.1  # of the places' code that is added to the features (SAM 2)


def sine_code(cells: int, channels: int) -> Float[Tensor, "n c"]:
    """A code of every cell's row and column, half of the channels each."""
    half = channels // 2
    steps = torch.arange(1, cells + 1) / cells * 2 * math.pi
    waves = BASE ** (2 * (torch.arange(half) // 2) / half)
    angles = steps[:, None] / waves
    codes = torch.where(torch.arange(half) % 2 == 0, angles.sin(), angles.cos())
    rows = codes[:, None].expand(cells, cells, half)
    columns = codes[None].expand(cells, cells, half)
    code = torch.zeros(cells * cells, channels)
    code[:, : 2 * half] = torch.cat([rows, columns], dim=-1).flatten(0, 1)
    return code


def rotary_angles(cells: int, channels: int) -> Float[Tensor, "n half"]:
    """How far each pair of channels turns at each cell: by column, then by row."""
    quarter = channels // 4
    waves = BASE ** -(torch.arange(quarter) / quarter)
    place = torch.arange(cells, dtype=torch.float32)
    rows, columns = torch.meshgrid(place, place, indexing="ij")
    by_column = columns.flatten()[:, None] * waves
    by_row = rows.flatten()[:, None] * waves
    return torch.cat([by_column, by_row], dim=-1)


def turns(angles: Float[Tensor, "n half"]) -> Complex[Tensor, "n half"]:
    """The angles as complex numbers of length 1."""
    return torch.polar(torch.ones_like(angles), angles)


def turned(x: Float[Tensor, "b n d"], by: Complex[Tensor, "n half"]) -> Tensor:
    """Each pair of channels, turned by its cell's angle."""
    pairs = torch.view_as_complex(x.float().view(*x.shape[:-1], -1, 2))
    return torch.view_as_real(pairs * by).flatten(-2).to(x.dtype)


class Look(nn.Module):
    """Attention with one head, from features to themselves or to memory."""

    def __init__(self, channels: int, memory: int):
        super().__init__()
        self.q, self.k = nn.Linear(channels, channels), nn.Linear(memory, channels)
        self.v, self.out = nn.Linear(memory, channels), nn.Linear(channels, channels)
        # torch's own start is a third as wide: what is found would be lost beside the features.
        for layer in (self.q, self.k, self.v, self.out):
            nn.init.xavier_uniform_(layer.weight)

    def forward(
        self,
        features: Float[Tensor, "b n d"],
        keys: Float[Tensor, "b m c"],
        values: Float[Tensor, "b m c"],
        angles: Tensor,
        key_angles: Tensor,
        mask: Tensor | None = None,
        bias: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """What was found (b n d), and the weights (b n m)."""
        q = turned(self.q(features), angles)
        k = turned(self.k(keys), key_angles)
        weights = weigh(q[:, None], k[:, None], mask, bias)[:, 0]
        found: Tensor = self.out(weights @ self.v(values))
        return found, weights


class Layer(nn.Module):
    """Looks at itself, then at memory, then a feed-forward net; each on normalised features."""

    def __init__(self, channels: int, settings: config.Memory):
        super().__init__()
        self.within = Look(channels, channels)
        self.back = Look(channels, settings.channels)
        self.feedforward = nn.Sequential(
            nn.Linear(channels, settings.feedforward), nn.ReLU(), nn.Dropout(settings.dropout),
            nn.Linear(settings.feedforward, channels),
        )  # fmt: skip
        self.norms = nn.ModuleList(nn.LayerNorm(channels) for _ in range(3))
        self.dropout = nn.Dropout(settings.dropout)
        # beta of -beta |dx|^2, in cells; after a softplus it is 2 at first (models.md 4.3)
        self.closeness = nn.Parameter(torch.tensor(1.85)) if settings.colocation else None

    def forward(self, x: Tensor, read: "_Read") -> tuple[Tensor, Tensor]:
        """The features (b n d), and how they looked at memory (b n m)."""
        normed = self.norms[0](x)
        found, _ = self.within(normed, normed, normed, read.angles, read.angles)
        x = x + self.dropout(found)
        bias = None
        if self.closeness is not None and read.distances is not None:
            bias = -nn.functional.softplus(self.closeness) * read.distances
        found, weights = self.back(
            self.norms[1](x), read.keys, read.values, read.angles, read.key_angles, read.mask, bias
        )
        x = x + self.dropout(found)
        return x + self.dropout(self.feedforward(self.norms[2](x))), weights


class _Read(NamedTuple):
    """What every layer reads."""

    keys: Tensor  # b m c, with the codes of place and age
    values: Tensor  # b m c
    mask: Tensor  # b 1 1 m
    angles: Tensor  # n half, complex
    key_angles: Tensor  # m half; zero for the stage, which is nowhere
    distances: Tensor | None  # n m, squared, in cells; with colocation only


class Remembered(NamedTuple):
    """Features with memory read into them."""

    features: Float[Tensor, "e v d h w"]
    attention: Float[Tensor, "e v slots"]  # by slot, the stage last; a view's sum to 1


class MemoryAttention(nn.Module):
    """Layers of looking, a last normalisation, and, if it is asked for, a slow gate."""

    def __init__(self, channels: int, cells: int, slots: int, settings: config.Memory):
        super().__init__()
        self.layers = nn.ModuleList(Layer(channels, settings) for _ in range(settings.layers))
        self.norm = nn.LayerNorm(channels)
        # With the gate shut the features are exactly those that stage 1 trained (models.md A10).
        self.gate = nn.Parameter(torch.zeros(channels)) if settings.gate else None
        self.age = nn.Parameter(CODE_SCALE * torch.randn(slots, settings.channels))
        self.stage = nn.Parameter(CODE_SCALE * torch.randn(settings.channels))
        self.cells, self.slots = cells, slots
        angles = rotary_angles(cells, channels)
        nowhere = torch.zeros(1, angles.shape[1])
        self.register_buffer("angles", angles, persistent=False)
        self.register_buffer(
            "key_angles", torch.cat([angles] * slots + [nowhere]), persistent=False
        )
        self.register_buffer("place", sine_code(cells, settings.channels), persistent=False)
        self.register_buffer("query_place", sine_code(cells, channels), persistent=False)
        distances = _distances(cells) if settings.colocation else None
        self.register_buffer("distances", distances, persistent=False)

    angles: Tensor
    key_angles: Tensor
    place: Tensor
    query_place: Tensor
    distances: Tensor | None

    def forward(self, features: Float[Tensor, "e v d h w"], slots: Slots) -> Remembered:
        """The features, each view having looked at its own memory."""
        views = features.shape[1]
        present = rearrange(features, "e v d h w -> (e v) (h w) d")
        read = self._read(slots, views)
        x, attention = present + POSITION_SHARE * self.query_place, []
        for layer in self.layers:
            x, weights = layer(x, read)
            attention.append(weights.detach())
        remembered = self.norm(x)
        if self.gate is not None:
            remembered = present + self.gate * (remembered - present)
        back = rearrange(
            remembered, "(e v) (h w) d -> e v d h w", v=views, h=self.cells, w=self.cells
        )
        return Remembered(back, self._by_slot(torch.stack(attention).mean(dim=0), views))

    def _read(self, slots: Slots, views: int) -> _Read:
        entries = rearrange(slots.tokens, "e v s n c -> (e v) s n c")
        stage = repeat(slots.stage, "e c -> (e v) 1 c", v=views)
        coded = entries + self.place + self.age[:, None]
        shown = repeat(slots.present, "e s -> (e v) (s n)", v=views, n=self.cells**2)
        always = torch.ones(len(shown), 1, dtype=torch.bool, device=shown.device)
        return _Read(
            keys=torch.cat([coded.flatten(1, 2), stage + self.stage], dim=1),
            values=torch.cat([entries.flatten(1, 2), stage], dim=1),
            mask=torch.cat([shown, always], dim=1)[:, None, None],
            angles=turns(self.angles),
            key_angles=turns(self.key_angles),
            distances=self._distances(),
        )

    def _distances(self) -> Tensor | None:
        """To every key, if that counts; the stage is nowhere, and as near as anything."""
        if self.distances is None:
            return None
        stage = self.distances.new_zeros(len(self.distances), 1)
        return torch.cat([self.distances.repeat(1, self.slots), stage], dim=1)

    def _by_slot(self, weights: Tensor, views: int) -> Float[Tensor, "e v slots"]:
        by_key = weights.float().mean(dim=1)  # over the cells that look
        entries = by_key[:, :-1].view(len(by_key), self.slots, -1).sum(dim=2) if self.slots else (
            by_key[:, :0]
        )  # fmt: skip
        by_slot = torch.cat([entries, by_key[:, -1:]], dim=1)
        return rearrange(by_slot, "(e v) s -> e v s", v=views)


def _distances(cells: int) -> Float[Tensor, "n n"]:
    """Between the cells of a view, squared."""
    place = torch.arange(cells, dtype=torch.float32)
    rows, columns = torch.meshgrid(place, place, indexing="ij")
    xy = torch.stack([rows.flatten(), columns.flatten()], dim=-1)
    return ((xy[:, None] - xy[None]) ** 2).sum(dim=-1)
