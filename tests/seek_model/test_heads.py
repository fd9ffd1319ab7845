import torch
from torch import nn

from seek_model.heads import NOISE, ConditionalHead, JointHead, ProgressHead, _blurred


def head() -> ConditionalHead:
    torch.manual_seed(0)
    return ConditionalHead(32, nn.LayerNorm(32)).eval()


def test_later_angles_know_the_earlier_ones() -> None:
    made, features = head(), torch.randn(1, 32)
    torch.manual_seed(1)
    one = made(features, torch.tensor([[0, 0, 0]])).rotation
    torch.manual_seed(1)
    two = made(features, torch.tensor([[36, 0, 0]])).rotation

    assert torch.equal(one[:, 0], two[:, 0])
    assert not torch.allclose(one[:, 1], two[:, 1], atol=1e-3)
    assert not torch.allclose(one[:, 2], two[:, 2], atol=1e-3)


def test_alone_it_goes_on_from_its_own_angles() -> None:
    made, features = head(), torch.randn(4, 32)

    said = made(features, None)

    assert torch.equal(said.rotation, made(features, None).rotation)
    assert said.opening.shape == said.ignore_collisions.shape == (4, 2)


def test_the_noise_on_true_angles_is_even_and_wraps() -> None:
    """RVT-2's is not: its upper bound is exclusive (models.md 1.5)."""
    torch.manual_seed(0)
    bins = torch.zeros(2000, dtype=torch.long)

    drawn = _blurred(bins)

    assert set(drawn.tolist()) == {0, 1, 2, 70, 71}
    assert abs(float(((drawn + 36) % 72 - 36).float().mean())) < 0.15
    assert NOISE == 2


def test_the_joint_head_needs_no_truth() -> None:
    torch.manual_seed(0)
    made, features = JointHead(40), torch.randn(2, 40)

    assert torch.equal(
        made(features, None).rotation, made(features, torch.zeros(2, 3, dtype=torch.long)).rotation
    )


def test_progress_depends_on_the_stage_and_saturates() -> None:
    torch.manual_seed(0)
    made = ProgressHead(16, stages=4)
    features = torch.randn(1, 16).expand(4, -1)

    logits = made(features, torch.tensor([0, 1, 3, 12]))

    assert logits[0] != logits[1]
    assert logits[2] == logits[3]


def test_without_a_counter_progress_knows_no_stage() -> None:
    torch.manual_seed(0)
    made = ProgressHead(16, stages=0)
    features = torch.randn(1, 16).expand(2, -1)

    first, second = made(features, torch.tensor([0, 3]))

    assert torch.allclose(first, second)
