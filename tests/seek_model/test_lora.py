"""LoRA: nothing at first, all of q and v, and nothing else learns."""

import torch
from torch import nn

from seek_model.hiera import VARIANTS, Attention, ImageEncoder
from seek_model.lora import LoraQkv, add_lora, lora_parameters


def encoder() -> ImageEncoder:
    torch.manual_seed(0)
    return ImageEncoder(VARIANTS["toy"])


def test_fresh_lora_changes_nothing() -> None:
    network, images = encoder(), torch.rand(1, 3, 32, 32)
    before = network(images)

    add_lora(network, rank=2)

    for was, now in zip(before, network(images), strict=True):
        torch.testing.assert_close(was, now)


def test_own_weights_keep_their_names() -> None:
    network = encoder()
    before = set(network.state_dict())

    add_lora(network, rank=2)

    added = set(network.state_dict()) - before
    assert before <= set(network.state_dict())
    assert len(added) == 4 * len(network.trunk.blocks)


def test_all_channels_of_queries_and_values_are_adapted_where_the_width_changes() -> None:
    network = encoder()
    widths = [m.proj.out_features for m in network.modules() if isinstance(m, Attention)]

    add_lora(network, rank=2)

    layers = [module for module in network.modules() if isinstance(module, LoraQkv)]
    assert [layer.q_up.shape[0] for layer in layers] == widths == [16, 32, 64, 128]
    assert [layer.v_up.shape[0] for layer in layers] == widths


def test_keys_stay_as_they_are() -> None:
    torch.manual_seed(0)
    base = nn.Linear(4, 18)
    layer, x = LoraQkv(base, rank=2), torch.rand(3, 4)
    for parameter in layer.added():
        nn.init.normal_(parameter)

    change = (layer(x) - base(x)).abs().amax(dim=0).chunk(3)

    assert change[0].min() > 0 and change[2].min() > 0
    assert change[1].max() == 0


def test_gradients_reach_lora_only() -> None:
    network = encoder()
    add_lora(network, rank=2)
    for parameter in lora_parameters(network):
        nn.init.normal_(parameter)

    sum(level.square().mean() for level in network(torch.rand(1, 3, 32, 32))).backward()

    learning = {id(parameter) for parameter in lora_parameters(network)}
    for name, parameter in network.named_parameters():
        assert parameter.requires_grad == (id(parameter) in learning), name
        assert (parameter.grad is not None) == (id(parameter) in learning), name
        assert parameter.grad is None or parameter.grad.abs().max() > 0, name


def test_without_lora_there_are_no_parameters_of_it() -> None:
    assert lora_parameters(encoder()) == []
