import pytest
import torch

from seek_model.config import Config
from seek_model.network import Network, parameter_counts
from seek_model.presets import ABLATIONS, MODELS, NAMES, preset
from tests.seek_model.tiny import tiny

PUBLISHED = {  # parameters in millions, as published or counted on the published code
    "rvt2-paper": (67.2, 0.1),  # two nets of about 33.6
    "sam2act-paper": (69.1 + 67.2, 0.15),  # and Hiera-B+ with its neck
}


def built(config: Config) -> Network:
    with torch.device("meta"):
        return Network(config.model)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_comes_small_and_at_paper_size(name: str) -> None:
    base, _, size = name.rpartition("-")

    assert size in ("small", "paper")
    assert {f"{base}-small", f"{base}-paper"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_is_valid_named_and_without_a_clock(name: str) -> None:
    config = preset(name)

    assert config.name == name
    assert not config.model.clock
    assert preset(f"{name}+clock").model.clock
    assert Config.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize("name", [name for name in NAMES if "small" in name])
def test_every_small_row_can_be_built_and_takes_a_step(name: str) -> None:
    from tests.seek_model.tiny import frames, targets

    net, seen = Network(tiny(name).model), frames(1, 2)

    net(seen, targets(seen)).coarse.decoded.logits.sum().backward()


def test_the_paper_presets_have_the_papers_numbers() -> None:
    seek = preset("seek-paper")
    assert seek.train.augment.shift == (0.125, 0.125, 0.125) and seek.train.augment.turn == 45.0
    assert (seek.train.zoom_noise, seek.train.zoom_draw) == (0.05, "uniform")
    assert seek.model.views.zoom == 4.0
    first, second, memory = seek.train.first, seek.train.second, seek.model.memory

    assert memory and (memory.window, memory.anchor, memory.layers) == (6, "cosine", 4)
    assert (first.steps, first.horizon, first.warmup) == (57_140, 114_280, 2000)
    assert (first.batch, first.rate, first.decay, first.optimizer) == (56, 7e-4, 1e-4, "lamb")
    assert (second.steps, second.horizon, second.warmup) == (3575, 7150, 250)
    assert (second.batch, second.frames, second.rate, second.decay) == (64, 7, 2e-4, 0.0)
    assert second.freeze == ("encoder",)
    assert first.rate == pytest.approx(1.25e-5 * first.batch)
    assert seek.model.backbone.kind == "sam2" and seek.model.backbone.lora == 16
    assert not seek.model.stop


@pytest.mark.parametrize("name", PUBLISHED)
def test_paper_sizes_are_near_the_published_ones(name: str) -> None:
    parts = built(preset(name)).parts()
    reader = sum(p.numel() for p in parts["language"])
    millions = (sum(p.numel() for part in parts.values() for p in part) - reader) / 1e6
    wanted, tolerance = PUBLISHED[name]

    assert millions == pytest.approx(wanted, rel=tolerance)


def test_a_part_that_is_off_is_never_built() -> None:
    def names(row: str) -> set[str]:
        return {name for name, _ in Network(tiny(row).model).named_parameters()}

    assert not any("memory" in name for name in names("sam2act-small"))
    assert not any("boundary" in name for name in names("seek-small/wcm"))
    assert not any("nothing" in name for name in names("seek-small"))
    window = Network(tiny("seek-small/scm").model).coarse.memory
    assert window and window.episodes.slots == 0


def test_the_rows_of_a_table_differ_from_each_other() -> None:
    rows = [preset(f"seek-small/{row}") for row in ABLATIONS]
    kinds = {(c.model.model_dump_json(), c.train.model_dump_json()) for c in rows}

    assert len(kinds) == len(ABLATIONS)


def test_an_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="Did you mean seek-small"):
        preset("seek-smal")


def test_the_counts_of_parts_add_up_to_the_network() -> None:
    model = tiny().model

    counts = parameter_counts(model)

    assert sum(counts.values()) == sum(p.numel() for p in Network(model).parameters())
    assert counts["memory"] > 0
    assert "memory" not in parameter_counts(tiny("sam2act-small").model)
