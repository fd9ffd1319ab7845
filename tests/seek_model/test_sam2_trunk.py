"""SAM2Act's trunk: one encoder for both looks, and what of it is trained."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from seek_model.config import PatchTransformer, Sam2, Views
from seek_model.lora import lora_parameters
from seek_model.sam2_encoder import Sam2Encoder
from seek_model.sam2_trunk import Sam2Trunk, make_encoder
from seek_model.trunk import Words

TRANSFORMER = PatchTransformer(patch=8, channels=32, width=32, depth=2, heads=2, dropout=0.0)
TOY = Sam2(encoder="toy", image=32, lora=2, transformer=TRANSFORMER)
VIEWS = Views(size=32)


def trunk(encoder: Sam2Encoder, config: Sam2 = TOY) -> Sam2Trunk:
    return Sam2Trunk(config, VIEWS, 6, 3, encoder).eval()


def inputs(frames: int = 2) -> tuple[Tensor, Words, Tensor]:
    tokens = torch.randn(frames, 5, 6)
    words = Words(tokens, torch.ones(frames, 5, dtype=torch.bool), tokens.mean(dim=1))
    return torch.rand(frames, 3, 10, 32, 32), words, torch.rand(frames, 3)


@pytest.mark.parametrize("image", [32, 64])
def test_features_are_the_cells_of_the_transformer(image: int) -> None:
    torch.manual_seed(0)
    config = TOY.model_copy(update={"image": image})
    network = trunk(make_encoder(config), config)

    found = network(*inputs())

    assert found.features.shape == (2, 3, 32, 4, 4)
    assert [skip.shape for skip in found.skips] == [
        (6, network.skip_channels[0], image // 4, image // 4),
        (6, network.skip_channels[1], image // 8, image // 8),
    ]
    assert found.backbone.shape == (2, 3, network.backbone_channels)


def test_frames_of_a_batch_are_seen_as_if_alone() -> None:
    torch.manual_seed(0)
    network = trunk(make_encoder(TOY))
    images, words, fingers = inputs()

    with torch.no_grad():
        together = network(images, words, fingers)
        alone = network(images[1:], Words(*(part[1:] for part in words)), fingers[1:])

    torch.testing.assert_close(together.features[1:], alone.features)
    torch.testing.assert_close(together.skips[0][3:], alone.skips[0])
    torch.testing.assert_close(together.backbone[1:], alone.backbone)


def test_the_encoder_sees_colours_only() -> None:
    torch.manual_seed(0)
    network = trunk(make_encoder(TOY))
    images, words, fingers = inputs()
    elsewhere, recolored = images.clone(), images.clone()
    elsewhere[:, :, [0, 1, 2, 6, 7, 8, 9]] += 1
    recolored[:, :, 3:6] = 1 - recolored[:, :, 3:6]

    with torch.no_grad():
        before, same, other = (
            network(each, words, fingers) for each in (images, elsewhere, recolored)
        )

    assert torch.equal(before.backbone, same.backbone)
    assert not torch.equal(before.features, same.features)
    assert not torch.equal(before.backbone, other.backbone)


def test_both_looks_share_one_encoder_and_nothing_else() -> None:
    encoder = make_encoder(TOY)
    coarse, fine = trunk(encoder), trunk(encoder)

    shared = {id(p) for p in coarse.parameters()} & {id(p) for p in fine.parameters()}

    assert coarse.encoder is fine.encoder
    assert shared == {id(p) for p in encoder.parameters()}


def test_with_lora_the_skips_and_lora_are_trained() -> None:
    encoder = make_encoder(TOY)

    trained = {name for name, p in encoder.named_parameters() if p.requires_grad}

    assert {name for name in trained if "qkv" not in name} == {
        "conv_s0.weight", "conv_s0.bias", "conv_s1.weight", "conv_s1.bias"
    }  # fmt: skip
    assert sum("qkv" in name for name in trained) == len(lora_parameters(encoder)) == 16


def test_without_lora_all_is_trained() -> None:
    encoder = make_encoder(TOY.model_copy(update={"lora": 0}))

    assert all(parameter.requires_grad for parameter in encoder.parameters())


def test_weights_come_from_the_file_before_lora_is_added(tmp_path: Path) -> None:
    torch.manual_seed(1)
    published = make_encoder(TOY.model_copy(update={"lora": 0})).state_dict()
    named = {
        name if name.startswith("image_encoder.") else f"sam_mask_decoder.{name}": value
        for name, value in published.items()
    }
    save_file(named, tmp_path / "toy.safetensors")

    encoder = make_encoder(TOY.model_copy(update={"weights": str(tmp_path / "toy.safetensors")}))

    found = encoder.state_dict()
    assert all(torch.equal(found[name], value) for name, value in published.items())
    assert lora_parameters(encoder)


def test_an_image_that_does_not_suit_the_encoder_is_refused() -> None:
    with pytest.raises(ValueError, match="image = 40; SAM 2 needs a multiple of 32"):
        make_encoder(TOY.model_copy(update={"image": 40}))


def test_a_paper_sized_token_is_48_of_sam_48_of_the_patch_32_of_the_fingers() -> None:
    config = Sam2()
    with torch.device("meta"):
        network = Sam2Trunk(config, Views(size=224), 512, 4, make_encoder(config))

    assert network.narrow[0].weight.shape == (48, 256, 1, 1)
    assert network.cut[0].weight.shape == (48, 10, 14, 14)
    assert network.fingers[0].weight.shape == (32, 4)
    assert (network.cells, network.skip_channels, network.backbone_channels) == (16, (32, 64), 256)
