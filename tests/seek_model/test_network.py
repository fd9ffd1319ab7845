import dataclasses
from collections.abc import Sequence

import pytest
import torch
from torch import Tensor

from seek_model import losses, optim
from seek_model.clouds import SCALE
from seek_model.config import (
    ConvFilm,
    Language,
    Memory,
    Model,
    PatchTransformer,
    Phase,
    Train,
    Views,
)
from seek_model.frames import Frames
from seek_model.memory import Archive
from seek_model.network import Network, Predictions
from tests.seek_model.tiny import MEMORY, alone, frames, targets, tiny, tiny_model

GATED = MEMORY.model_copy(update={"gate": True})


def network(memory: Memory | None = MEMORY, **parts: object) -> Network:
    torch.manual_seed(0)
    return Network(tiny_model(memory, stop=True, **parts)).eval()


def played(net: Network, seen: Frames, archives: Sequence[Archive] = ()) -> list[Predictions]:
    """An episode of each sequence, played step by step by the network alone."""
    archives = archives or net.begin(seen.shape[0])
    found = []
    for step in range(seen.shape[1]):
        predictions, pending = net.play(seen.between(step, step + 1), archives)
        if pending:
            pending.commit()
        found.append(predictions)
    return found


def maps(predictions: Sequence[Predictions]) -> Tensor:
    return torch.stack([one.coarse.decoded.logits for one in predictions])


def test_nothing_of_a_later_observation_reaches_an_earlier_output() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(1, 5)
    changed = dataclasses.replace(
        seen, points=torch.where((seen.owner >= 3)[:, None], -seen.points, seen.points)
    )

    before, after = maps(played(net, seen)), maps(played(net, changed))

    assert torch.equal(before[:3], after[:3])
    assert not torch.allclose(before[3:], after[3:], atol=1e-4)


def test_in_training_too_nothing_of_a_later_observation_reaches_an_earlier_output() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(1, 5)
    wanted = targets(seen)
    changed = dataclasses.replace(
        seen, points=torch.where((seen.owner >= 3)[:, None], -seen.points, seen.points)
    )

    before = net(seen, wanted, coarse_only=True).coarse.decoded.logits
    after = net(changed, wanted, coarse_only=True).coarse.decoded.logits

    assert torch.equal(before[:3], after[:3])
    assert not torch.allclose(before[3:], after[3:], atol=1e-4)


def test_memory_is_written_after_the_prediction() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(1, 3)
    before = maps(played(net, seen))

    with torch.no_grad():
        assert net.coarse.memory
        for parameter in net.coarse.memory.encoder.parameters():
            parameter.add_(1.0)
    after = maps(played(net, seen))

    assert torch.equal(before[0], after[0])
    assert not torch.allclose(before[1], after[1], atol=1e-5)


def test_a_batch_of_episodes_at_different_steps_equals_each_alone() -> None:
    torch.manual_seed(1)
    net = network()
    present = torch.tensor([[1, 1, 1, 1, 1], [0, 0, 1, 1, 1], [1, 1, 0, 0, 0]], dtype=torch.bool)
    seen = frames(3, 5, present)

    archives = net.begin(3)
    together: dict[tuple[int, int], Tensor] = {}
    for step in range(5):
        now = seen.between(step, step + 1)
        said, pending = net.play(now, archives)
        assert pending
        pending.commit()
        for row, sequence in enumerate(said.rows.sequence.tolist()):
            together[sequence, step] = said.coarse.decoded.logits[row]

    for sequence in range(3):
        own = maps(played(net, alone(seen, sequence)))[:, 0]
        batched = torch.stack([v for (s, _), v in sorted(together.items()) if s == sequence])
        assert torch.allclose(own, batched, atol=1e-4)


def test_a_batch_of_training_sequences_equals_each_alone() -> None:
    torch.manual_seed(1)
    net = network()
    present = torch.tensor([[1, 1, 1, 1], [0, 1, 1, 1], [1, 1, 1, 0]], dtype=torch.bool)
    seen = frames(3, 4, present)

    together = net(seen, targets(seen), coarse_only=True)

    for sequence in range(3):
        one = alone(seen, sequence)
        own = net(one, targets(one), coarse_only=True).coarse.decoded.logits
        rows = together.rows.sequence == sequence
        assert torch.allclose(together.coarse.decoded.logits[rows], own, atol=1e-4)


def test_training_and_play_run_the_same_step() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(2, 4)
    online = played(net, seen)
    done = torch.stack([one.coarse.done for one in online], dim=1)

    taught = net(seen, dataclasses.replace(targets(seen), stage=done), coarse_only=True)

    logits = taught.coarse.decoded.logits.view(4, 2, 3, 16, 16)
    assert torch.allclose(logits, maps(online), atol=1e-5)


def test_counts_follow_the_networks_own_boundaries() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(1, 6)

    said = played(net, seen)

    ends = torch.stack(
        [one.coarse.boundary[0] > 0 for one in said if one.coarse.boundary is not None]
    )
    done = [int(one.coarse.done[0]) for one in said]
    assert done == [0, *ends.cumsum(0).tolist()[:-1]]


@pytest.mark.parametrize(("bias", "counts"), [(-1e4, [0, 0, 0, 0]), (1e4, [0, 1, 2, 3])])
def test_a_boundary_head_that_always_or_never_fires_moves_the_counter_so(
    bias: float, counts: list[int]
) -> None:
    net, seen = network(), frames(1, 4)
    assert net.coarse.memory and net.coarse.memory.boundary
    with torch.no_grad():
        net.coarse.memory.boundary.net[-1].bias.fill_(bias)

    assert [int(one.coarse.done[0]) for one in played(net, seen)] == counts


def test_what_is_not_committed_leaves_no_trace() -> None:
    torch.manual_seed(1)
    net, seen = network(), frames(1, 1)
    archives = net.begin(1)

    first, _ = net.play(seen, archives)
    second, _ = net.play(seen, archives)

    assert not archives[0].entries
    assert torch.equal(maps([first]), maps([second]))


def test_with_the_gate_shut_the_network_is_the_memory_free_one() -> None:
    torch.manual_seed(1)
    free, gated, seen = network(None), network(GATED), frames(2, 4)
    there = gated.state_dict()
    gated.load_state_dict(there | {k: v for k, v in free.state_dict().items() if "stop" not in k})

    assert torch.allclose(maps(played(gated, seen)), maps(played(free, seen)), atol=1e-6)


def test_in_the_past_of_a_sequence_only_the_encoder_of_memory_learns() -> None:
    torch.manual_seed(1)
    net, seen = network(MEMORY.model_copy(update={"window": 0})), frames(2, 4)
    supervised = torch.zeros(2, 4, dtype=torch.bool)
    supervised[:, 3:] = True  # what is remembered lies wholly in the past
    learns: dict[str, list[bool]] = {"trunk": [], "decoder": []}
    for name, told in learns.items():
        part = getattr(net.coarse, name)
        part.register_forward_hook(lambda *_, told=told: told.append(torch.is_grad_enabled()))

    loss = net(seen, targets(seen, supervised), coarse_only=True).coarse.decoded.logits.square()
    assert net.coarse.memory
    encoder = list(net.coarse.memory.encoder.parameters())
    given = torch.autograd.grad(loss.sum(), encoder, allow_unused=True)

    assert learns["trunk"] == [False, True]  # the past is seen first, then the rest
    assert learns["decoder"] == [False, False, False, True]  # step by step
    assert any(gradient is not None and gradient.abs().sum() > 0 for gradient in given)


def test_sequences_and_updates_draw_random_anchors_of_their_own() -> None:
    torch.manual_seed(1)
    net = network(MEMORY.model_copy(update={"window": 0, "anchor": "random"}))
    seen = frames(8, 8)
    supervised = torch.zeros(8, 8, dtype=torch.bool)
    supervised[:, 7:] = True

    def drawn() -> list[int]:
        said = net(seen, targets(seen, supervised), coarse_only=True).coarse
        assert said.recalled
        return [one.entry.decision for one in said.recalled.slots.anchors if one]

    first, second = drawn(), drawn()

    assert len(first) == 8
    assert len(set(first)) > 2
    assert first != second


def test_frames_that_are_not_supervised_count_for_nothing() -> None:
    seen = frames(2, 3, torch.tensor([[1, 1, 1], [1, 0, 0]], dtype=torch.bool))
    supervised = torch.tensor([[0, 1, 1], [1, 0, 0]], dtype=torch.bool)

    rows = network()(seen, targets(seen, supervised)).rows

    pairs = list(zip(rows.sequence.tolist(), rows.step.tolist(), strict=True))
    assert sorted(pairs) == [(0, 1), (0, 2), (1, 0)]


def test_predictions_name_the_frames_that_were_given_whatever_lies_in_the_past() -> None:
    seen = frames(2, 5)
    supervised = torch.zeros(2, 5, dtype=torch.bool)
    supervised[0, 2:4] = supervised[1, 3:] = True

    rows = network()(seen, targets(seen, supervised), coarse_only=True).rows

    pairs = list(zip(rows.sequence.tolist(), rows.step.tolist(), strict=True))
    assert sorted(pairs) == [(0, 2), (0, 3), (1, 3), (1, 4)]


def test_a_past_makes_no_loss_of_its_own() -> None:
    """The memory-free loss of a window is the same with its past in front and without."""
    torch.manual_seed(1)
    net, seen = network(None), frames(1, 5)
    wanted = targets(seen, torch.tensor([[False, False, True, True, True]]))
    window = seen.between(2, 5)
    own = dataclasses.replace(
        wanted, **{name: value[:, 2:] for name, value in vars(wanted).items()}
    )
    phase = Phase(steps=1, horizon=1, warmup=0, batch=1, frames=3, loss="coarse")

    long, short = (
        losses.total(net(some, true, coarse_only=True), true, net, Train(), phase)
        for some, true in ((seen, wanted), (window, own))
    )

    assert torch.allclose(long["translation"], short["translation"], atol=1e-6)


def test_a_network_with_memory_says_the_whole_action() -> None:
    """SAM2Act+'s defect D2: with memory its heads for the rest of the action gave nothing."""
    (said,) = played(network(), frames(2, 1))

    assert said.said is not None and said.position is not None
    assert said.said.rotation.shape == (2, 3, 72)
    assert said.said.opening.shape == said.said.ignore_collisions.shape == (2, 2)
    assert said.position.shape == (2, 3)
    assert said.position.abs().max() <= 1.5


def test_the_fine_branch_reads_no_memory() -> None:
    net = network()
    assert net.fine

    names = [name for name, _ in net.fine.named_parameters()]

    assert not [name for name in names if "memory" in name]


@pytest.mark.parametrize(
    ("draw", "deviation", "most"), [("normal", 1.0, 3.0), ("uniform", 3**-0.5, 1.0)]
)
def test_in_training_the_fine_look_misses_its_target_as_it_is_told(
    draw: str, deviation: float, most: float
) -> None:
    torch.manual_seed(0)
    seen = frames(16, 12)
    wanted = targets(seen)

    said = Network(tiny_model(memory=None))(seen, wanted, zoom_noise=0.02, zoom_draw=draw)

    true = wanted.at(said.rows.sequence, said.rows.step).position
    off = (said.fine.center - true) / (0.02 * SCALE)
    assert off.std().item() == pytest.approx(deviation, rel=0.1)
    assert 0.9 * most < off.abs().max().item() <= most + 1e-4


def test_the_clock_is_told_only_where_it_is_asked_for() -> None:
    torch.manual_seed(1)
    seen = frames(1, 1)
    later = dataclasses.replace(seen, decision=seen.decision + 5)

    plain, clocked = network(None), network(None, clock=True)

    assert torch.equal(maps(played(plain, seen)), maps(played(plain, later)))
    assert not torch.allclose(maps(played(clocked, seen)), maps(played(clocked, later)), atol=1e-5)


def test_the_same_network_says_the_same_twice() -> None:
    torch.manual_seed(1)
    seen = frames(1, 4)

    assert torch.equal(maps(played(network(), seen)), maps(played(network(), seen)))


@pytest.mark.parametrize("name", ["rvt-small", "rvt2-small", "sam2act-small", "sam2act_plus-small"])
def test_every_small_baseline_trains_and_plays(name: str) -> None:
    torch.manual_seed(0)
    net, seen = Network(tiny(name).model), frames(2, 2)

    predictions = net(seen, targets(seen))
    predictions.coarse.decoded.logits.sum().backward()
    said = played(net.eval(), seen)

    assert predictions.said is not None
    assert all(one.position is not None for one in said)


def test_parts_name_every_parameter_once() -> None:
    net = network()

    found = [id(parameter) for part in net.parts().values() for parameter in part]

    assert len(found) == len(set(found))
    assert set(found) == {id(parameter) for parameter in net.parameters()}


def test_a_model_whose_parts_do_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="no multiple"):
        Model(views=Views(size=20), backbone=ConvFilm(widths=(8, 8, 8)))
    with pytest.raises(ValueError, match="single stage"):
        Model(views=Views(size=64, stages=1))
    patches = {"backbone": PatchTransformer(patch=8), "decoder": "convex"}
    with pytest.raises(ValueError, match=r"views\.layers needs backbone\.kind = conv_film"):
        Model(views=Views(layers=2), **patches)
    with pytest.raises(ValueError, match=r"language\.colors needs"):
        Model(language=Language(colors=1), **patches)


def test_what_starts_anew_with_memory_is_trained_where_all_else_is_frozen() -> None:
    """The stop head starts fresh in the second phase: frozen, it would stop at random."""
    net, phase = network(), Phase(steps=1, horizon=1, warmup=0, batch=1, freeze=("all_but_memory",))

    optim.freeze(net, phase)

    assert net.coarse.stop
    assert all(parameter.requires_grad for parameter in net.coarse.stop.parameters())
    assert not net.coarse.trunk.position.requires_grad
