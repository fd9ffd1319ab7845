"""A preset by name, a TOML file that changes one, and every way to get it wrong."""

from pathlib import Path

import pytest

from seek_model import recipes
from seek_model.config import ConvFilm
from seek_model.presets import NAMES, preset
from seek_model.recipes import BadRecipe, read, scaled
from tests.seek_model.trainings import tiny

CONFIGS = Path(recipes.__file__).parent / "configs"


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_is_a_recipe(name: str) -> None:
    assert read(name) == preset(name)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_a_file_of_the_package_can_be_followed_and_says_what_it_is(path: Path) -> None:
    assert path.read_text().startswith("# ")
    assert read(str(path)).name == path.stem
    if path.stem in NAMES:
        assert read(str(path)) == preset(path.stem)


def test_what_a_file_names_is_changed_and_nothing_else(recipe: Path) -> None:
    recipe.write_text(
        'preset = "seek-small"\n[model.memory]\nwindow = 4\n[train.first]\nsteps = 7\n'
        '[train]\ntasks = ["search_drawer"]\n'
    )

    config, base = read(str(recipe)), preset("seek-small")

    assert base.model.memory
    assert config.name == "mine"
    assert config.model.memory == base.model.memory.model_copy(update={"window": 4})
    assert config.model.views == base.model.views
    assert config.train.first == base.train.first.model_copy(update={"steps": 7})
    assert config.train.tasks == ("search_drawer",)


def test_memory_can_be_taken_away_and_given(recipe: Path) -> None:
    recipe.write_text('preset = "seek-small"\nmodel = {memory = "none"}\n')
    assert read(str(recipe)).model.memory is None

    recipe.write_text('preset = "sam2act-small"\n[model.memory]\nwindow = 3\n')
    memory = read(str(recipe)).model.memory
    assert memory and memory.window == 3


def test_another_kind_of_backbone_starts_from_its_own_defaults(recipe: Path) -> None:
    recipe.write_text(
        'preset = "rvt2-paper"\n[model]\ndecoder = "pyramid"\n[model.backbone]\n'
        'kind = "conv_film"\nchannels = 96\n'
    )

    assert read(str(recipe)).model.backbone == ConvFilm(channels=96)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('presets = "seek-small"', "no key 'presets'. Did you mean preset? Allowed: preset, name"),
        ("[model]\nclock = true", "preset is missing. Presets: rvt-small"),
        ('preset = "seek-smal"', "No preset 'seek-smal'. Did you mean seek-small? Presets:"),
        (
            'preset = "seek-small"\n[model.memory]\nwindw = 3',
            "no key 'model.memory.windw'. Did you mean window? Allowed: window, anchor, stages,",
        ),
        (
            'preset = "seek-small"\n[train.first]\nstep = 3',
            "no key 'train.first.step'. Did you mean steps? Allowed: steps, horizon,",
        ),
        (
            'preset = "seek-small"\n[model.backbone]\npatch = 3',
            "no key 'model.backbone.patch'. Allowed: kind, widths,",
        ),
        ('preset = "seek-small"\n[training]\na = 1', "no key 'training'. Did you mean train?"),
        (
            'preset = "seek-small"\n[train]\nprecision = "fp16"',
            "train.precision = 'fp16': Input should be 'bf16' or 'fp32'",
        ),
        (
            'preset = "seek-small"\n[model.views]\nsize = 63',
            "63 is no multiple of the backbone's stride",
        ),
        ('preset = "seek-small"\n[model.views]\nsize = -1', "model.views.size = -1: Input should"),
        ("preset = ", "is no TOML"),
    ],
)
def test_a_wrong_recipe_is_one_line_that_names_the_key(
    recipe: Path, text: str, message: str
) -> None:
    recipe.write_text(text)

    with pytest.raises(BadRecipe) as error:
        read(str(recipe))

    assert message in str(error.value)
    assert str(recipe) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_or_preset_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match=r"none\.toml: No such file"):
        read(str(tmp_path / "none.toml"))
    with pytest.raises(BadRecipe, match="No preset 'fly'"):
        read("fly")


def test_a_scaled_training_is_longer_in_all_its_steps() -> None:
    before, after = tiny().train, scaled(tiny(), 3).train

    for name in ("first", "second"):
        old, new = getattr(before, name), getattr(after, name)
        assert (new.steps, new.horizon, new.warmup) == (3 * old.steps, 24, 6)
        assert new.batch == old.batch
