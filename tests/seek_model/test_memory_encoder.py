import torch

from seek_model.memory_encoder import MemoryEncoder


def encoder(**kind: str) -> MemoryEncoder:
    torch.manual_seed(0)
    chosen = {"heatmap": "max", "content": "visual"} | kind
    return MemoryEncoder(16, 8, size=28, cells=4, **chosen).eval()


def inputs() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    torch.manual_seed(1)
    return torch.randn(2, 3, 16, 4, 4), 3 * torch.randn(2, 3, 28, 28), torch.rand(2, 10)


def test_an_entry_has_a_token_for_every_cell_of_every_view() -> None:
    assert encoder()(*inputs()).shape == (2, 3, 16, 8)


def test_the_offset_of_a_heat_maps_logits_means_nothing() -> None:
    """SAM2Act+'s defect D5: a sigmoid of softmax logits saturates by an arbitrary offset."""
    features, logits, body = inputs()

    by_maximum, by_sigmoid = encoder(), encoder(heatmap="sigmoid")

    shifted = by_maximum(features, logits + 50, body)
    assert torch.allclose(shifted, by_maximum(features, logits, body), atol=1e-5)
    assert not torch.allclose(
        by_sigmoid(features, logits + 50, body), by_sigmoid(features, logits, body), atol=1e-2
    )


def test_both_what_was_seen_and_where_the_policy_went_are_stored() -> None:
    made, (features, logits, body) = encoder(), inputs()
    entry = made(features, logits, body)

    assert not torch.allclose(made(features + 1, logits, body), entry, atol=1e-3)
    assert not torch.allclose(made(features, logits.flip(-1), body), entry, atol=1e-3)
    assert torch.equal(made(features, logits, body + 1), entry)


def test_proprioception_stores_the_body_and_nothing_that_was_seen() -> None:
    made, (features, logits, body) = encoder(content="proprioception"), inputs()
    entry = made(features, logits, body)

    assert entry.shape == encoder()(features, logits, body).shape
    assert torch.equal(made(features + 1, logits.flip(-1), body), entry)
    assert not torch.allclose(made(features, logits, body + 1), entry, atol=1e-4)


def test_a_place_in_the_heat_map_is_the_same_place_in_the_entry() -> None:
    torch.manual_seed(0)
    made = MemoryEncoder(16, 8, size=64, cells=8, heatmap="max", content="visual").eval()
    features, body = torch.zeros(1, 1, 16, 8, 8), torch.rand(1, 10)
    left, right = torch.zeros(2, 1, 1, 64, 64).unbind(0)
    left[..., 32, 4], right[..., 32, 60] = 30.0, 30.0

    moved = (made(features, left, body) - made(features, right, body)).norm(dim=-1)

    by_column = moved[0, 0].view(8, 8).mean(dim=0)
    assert by_column[[0, 7]].min() > 10 * by_column[[3, 4]].max()
