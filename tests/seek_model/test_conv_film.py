import torch

from seek_model.config import ConvFilm, Views
from seek_model.conv_film import ConvFilmTrunk, PyramidDecoder
from seek_model.trunk import Words

CONFIG = ConvFilm(widths=(8, 16, 16), channels=16, depth=2, heads=2)


def trunk() -> ConvFilmTrunk:
    torch.manual_seed(0)
    return ConvFilmTrunk(CONFIG, Views(size=32), words=8, fingers=3).eval()


def words(frames: int) -> Words:
    mask = torch.ones(frames, 5, dtype=torch.bool)
    mask[:, 3:] = False
    return Words(torch.randn(frames, 5, 8), mask, torch.randn(frames, 8))


def test_features_have_the_size_that_the_trunk_says() -> None:
    made = trunk()

    seen = made(torch.randn(2, 3, 10, 32, 32), words(2), torch.rand(2, 3))

    assert seen.features.shape == (2, 3, made.channels, made.cells, made.cells)
    assert [skip.shape[1] for skip in seen.skips] == list(made.skip_channels)
    assert [skip.shape[-1] for skip in seen.skips] == [16, 8]
    assert seen.backbone.shape == (2, 3, made.backbone_channels)


def test_the_instruction_reaches_every_level_of_the_pyramid() -> None:
    made, images, said, fingers = trunk(), torch.randn(1, 3, 10, 32, 32), words(1), torch.rand(1, 3)
    other = said._replace(pooled=said.pooled + 1)

    one, two = made(images, said, fingers), made(images, other, fingers)

    for a, b in zip((*one.skips, one.features), (*two.skips, two.features), strict=True):
        assert not torch.allclose(a, b, atol=1e-4)


def test_words_that_are_not_there_change_nothing() -> None:
    made, images, said, fingers = trunk(), torch.randn(1, 3, 10, 32, 32), words(1), torch.rand(1, 3)
    tokens = said.tokens.clone()
    tokens[:, 3:] += 100

    one, two = made(images, said, fingers), made(images, said._replace(tokens=tokens), fingers)

    assert torch.equal(one.features, two.features)


def test_views_look_at_each_other() -> None:
    made, images, said, fingers = trunk(), torch.randn(1, 3, 10, 32, 32), words(1), torch.rand(1, 3)
    changed = images.clone()
    changed[:, 0] = 0

    one, two = made(images, said, fingers), made(changed, said, fingers)

    assert not torch.allclose(one.features[:, 1], two.features[:, 1], atol=1e-5)
    assert torch.equal(one.skips[0][1], two.skips[0][1])  # the pyramid sees single views


def test_a_frame_is_the_same_in_any_batch() -> None:
    made, images, said, fingers = trunk(), torch.randn(3, 3, 10, 32, 32), words(3), torch.rand(3, 3)

    together = made(images, said, fingers).features

    alone = made(images[1:2], Words(*(part[1:2] for part in said)), fingers[1:2]).features
    assert torch.allclose(together[1:2], alone, atol=1e-5)


def test_the_decoder_gives_one_map_a_view_and_uses_the_finer_levels() -> None:
    made, decoder = trunk(), PyramidDecoder(16, (8, 16), 32)
    seen = made(torch.randn(2, 3, 10, 32, 32), words(2), torch.rand(2, 3))
    skips = (seen.skips[0] + 1, seen.skips[1])

    one, two = decoder(seen.features, seen.skips), decoder(seen.features, skips)

    assert one.logits.shape == (2, 3, 32, 32)
    assert not torch.allclose(one.logits, two.logits, atol=1e-4)
