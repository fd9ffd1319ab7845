"""The paper's own sizes: one step of each phase, at a batch that a CPU can bear."""

import pytest
import torch

from seek_model.config import Config, Language
from seek_model.distributed import Group
from seek_model.memory import write
from seek_model.network import Network
from seek_model.presets import preset
from seek_model.trainer import Trainer
from seek_model.validation import Precision
from tests.seek_model.tiny import frames, targets

ALONE = Group(rank=0, world=1, device=torch.device("cpu"))
BF16 = Precision(torch.device("cpu"), bf16=True)


def seek() -> Config:
    """SEEK at paper size; CLIP's files are nobody's to hand on, so the words are read by ours."""
    config = preset("seek-paper")
    model = config.model.model_copy(update={"language": Language(channels=512, tokens=77)})
    return config.model_copy(update={"model": model})


@pytest.mark.slow
def test_one_step_of_each_phase_moves_what_it_should() -> None:
    seen = frames(2, 1, points=20_000)  # RVT-2 normalises over the batch
    first = Trainer("first", seek(), ALONE, None)
    adapters = [weight.clone() for weight in first.network.parts()["lora"]]

    losses = first.update(seen, targets(seen), BF16, False)

    assert losses["total"] > 0
    moved = first.network.parts()
    assert any(not torch.equal(a, b) for a, b in zip(adapters, moved["lora"], strict=True))
    zeros = [weight for weight in moved["lora"] if not weight.any()]
    assert not zeros  # B starts at zero and must not stay there

    second = Trainer("second", seek(), ALONE, first.averaged)
    encoder = [weight.clone() for weight in second.network.parts()["encoder"]]
    seen = frames(1, 2, points=20_000)

    losses = second.update(seen, targets(seen), BF16, False)

    assert losses["boundary"] > 0
    now = second.network.parts()["encoder"]
    assert all(torch.equal(a, b) for a, b in zip(encoder, now, strict=True))
    assert any(weight.grad is not None for weight in second.network.parts()["memory"])


@pytest.mark.slow
def test_a_decision_at_paper_size_reads_six_entries_and_an_anchor() -> None:
    torch.manual_seed(0)
    net = Network(seek().model).eval()
    archives, seen = net.begin(1), frames(1, 1, points=20_000)
    for decision in range(7):
        write(archives[0], decision, torch.randn(3 * 128), torch.randn(3, 256, 64))

    said, pending = net.play(seen, archives)

    recalled = said.coarse.recalled
    assert recalled and recalled.slots.tokens.shape == (1, 3, 7, 256, 64)
    assert recalled.slots.windows == [[1, 2, 3, 4, 5, 6]]
    assert recalled.slots.anchors[0] and recalled.slots.anchors[0].entry.decision == 0
    assert said.position is not None
    assert pending and pending.tokens.shape == (1, 3, 256, 64)
