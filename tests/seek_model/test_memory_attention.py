import torch
from torch import Tensor

from seek_model.attention import attend, weigh
from seek_model.config import Memory
from seek_model.memory import Slots
from seek_model.memory_attention import (
    MemoryAttention,
    rotary_angles,
    sine_code,
    turned,
    turns,
)

CELLS, CHANNELS = 4, 16
SETTINGS = Memory(window=2, channels=8, layers=2, feedforward=16, dropout=0.0)


def attention(slots: int = 3, **changes: object) -> MemoryAttention:
    torch.manual_seed(0)
    settings = SETTINGS.model_copy(update=changes)
    return MemoryAttention(CHANNELS, CELLS, slots, settings).eval()


def slots(present: list[list[bool]], tokens: Tensor | None = None) -> Slots:
    shape = (len(present), 3, len(present[0]), CELLS**2, 8)
    return Slots(
        tokens=torch.randn(shape) if tokens is None else tokens,
        present=torch.tensor(present, dtype=torch.bool),
        stage=torch.randn(len(present), 8),
        windows=[[] for _ in present],
        anchors=[None for _ in present],
    )


def test_every_cell_has_its_own_code_of_place() -> None:
    codes = sine_code(CELLS, 16)

    assert len(torch.unique(codes.round(decimals=4), dim=0)) == CELLS**2


def test_rotary_products_depend_on_the_difference_of_places_alone() -> None:
    torch.manual_seed(0)
    q, k = torch.randn(2, 1, 1, 16)
    angles = turns(rotary_angles(8, 16)).view(8, 8, -1)

    def product(one: tuple[int, int], other: tuple[int, int]) -> Tensor:
        at = turned(q, angles[one][None]) * turned(k, angles[other][None])
        return at.sum()

    assert torch.allclose(product((1, 2), (3, 5)), product((4, 1), (6, 4)), atol=1e-5)
    assert not torch.allclose(product((1, 2), (3, 5)), product((1, 2), (5, 3)), atol=1e-2)


def test_a_turn_keeps_lengths() -> None:
    x = torch.randn(2, 16, 16)

    assert torch.allclose(
        turned(x, turns(rotary_angles(4, 16))).norm(dim=-1), x.norm(dim=-1), atol=1e-5
    )


def test_each_view_reads_with_its_own_cells_code() -> None:
    """SAM2Act+'s defect D1: codes were laid out over views and cells in the wrong order."""
    made, features = attention(), torch.randn(1, 1, CHANNELS, CELLS, CELLS)
    tokens = torch.randn(1, 1, 3, CELLS**2, 8)
    thrice = slots([[True, True, True]], tokens.expand(1, 3, -1, -1, -1))

    read = made(features.expand(1, 3, -1, -1, -1), thrice).features

    assert torch.allclose(read[:, 0], read[:, 1], atol=1e-6)
    assert torch.allclose(read[:, 0], read[:, 2], atol=1e-6)


def test_the_code_does_not_depend_on_the_batch() -> None:
    made = attention()
    features, memory = torch.randn(4, 3, CHANNELS, CELLS, CELLS), slots([[True, True, False]] * 4)

    together = made(features, memory).features
    alone = [
        made(features[i : i + 1], Slots(*(part[i : i + 1] for part in memory))).features
        for i in range(4)
    ]

    assert torch.allclose(together, torch.cat(alone), atol=1e-5)


def test_what_a_missing_entry_holds_changes_nothing() -> None:
    made, features = attention(), torch.randn(1, 3, CHANNELS, CELLS, CELLS)
    memory = slots([[True, False, False]])
    other = memory.tokens.clone()
    other[:, :, 1:] = 1000.0

    read = made(features, memory).features

    assert torch.equal(read, made(features, memory._replace(tokens=other)).features)


def test_shares_of_attention_sum_to_one_over_the_entries_that_are_there() -> None:
    made, features = attention(), torch.randn(2, 3, CHANNELS, CELLS, CELLS)

    shares = made(features, slots([[True, False, True], [False, False, False]])).attention

    assert shares.shape == (2, 3, 4)
    assert torch.allclose(shares.sum(dim=-1), torch.ones(2, 3), atol=1e-5)
    assert torch.all(shares[0, :, 1] == 0)
    assert torch.allclose(shares[1, :, 3], torch.ones(3))


def test_without_any_entry_the_layers_still_run_so_statistics_do_not_jump() -> None:
    """SAM2Act+'s defect D6: the first step went round attention and its last normalisation."""
    made, features = attention(), 5 + 3 * torch.randn(1, 3, CHANNELS, CELLS, CELLS)

    first = made(features, slots([[False, False, False]])).features

    assert torch.allclose(first.mean(dim=2), torch.zeros(1, 3, CELLS, CELLS), atol=1e-4)


def test_a_shut_gate_leaves_the_features_exactly() -> None:
    made, features = attention(gate=True), torch.randn(1, 3, CHANNELS, CELLS, CELLS)

    assert torch.equal(made(features, slots([[True, True, True]])).features, features)


def test_colocation_draws_attention_to_the_same_place() -> None:
    near = attention(slots=1, colocation=True, layers=1)
    with torch.no_grad():
        for parameter in near.layers[0].back.parameters():
            parameter.zero_()
    features = torch.zeros(1, 3, CHANNELS, CELLS, CELLS)

    seen = near.layers[0]
    read = near._read(slots([[True]]), 3)
    _, weights = seen(features.flatten(3).flatten(0, 1).transpose(1, 2), read)

    own = weights[0, :, : CELLS**2].diagonal()
    assert torch.all(own >= weights[0, :, : CELLS**2].amax(dim=1) - 1e-6)
    assert torch.all(own > 2 * weights[0, :, : CELLS**2].mean(dim=1))


def test_attention_without_any_key_is_finite() -> None:
    q, k, v = torch.randn(3, 1, 1, 2, 4)

    found = attend(q, k, v, mask=torch.zeros(1, 1, 2, 2, dtype=torch.bool))

    assert torch.isfinite(found).all()


def test_attention_is_what_torch_says_it_is() -> None:
    torch.manual_seed(0)
    q, k, v = torch.randn(3, 2, 3, 5, 8)
    mask = torch.rand(2, 1, 5, 5) > 0.3
    mask[..., 0] = True

    ours = attend(q, k, v, mask=mask)
    theirs = torch.nn.functional.scaled_dot_product_attention(q, k, v, attn_mask=mask)

    assert torch.allclose(ours, theirs, atol=1e-5)
    assert torch.allclose(weigh(q, k, mask).sum(dim=-1), torch.ones(2, 3, 5))
