"""Which trainings the study has."""

import subprocess
import sys
from pathlib import Path

import pytest

from hide_tasks import SUITES, load
from seek_model.config import Config
from seek_model.presets import preset
from seek_model.recipes import read
from seek_model.study import FIRST, FULL, STUDIES, TINY, Run, Study, is_of, recipe

ROOT = Path(__file__).parents[2]


@pytest.fixture(params=STUDIES.values(), ids=STUDIES)
def study(request: pytest.FixtureRequest) -> Study:
    found: Study = request.param
    return found


def config_of(run: Run, **changes: object) -> Config:
    config = preset(run.preset)
    train = {"seed": run.seed, "start": run.start} | changes
    return config.model_copy(update={"train": config.train.model_copy(update=train)})


def test_every_run_has_a_name_of_its_own_and_a_preset(study: Study) -> None:
    assert len({run.name for run in study.runs}) == len(study.runs)
    for run in study.runs:
        assert preset(run.preset).name == run.preset


def test_every_run_goes_on_from_the_one_first_phase(study: Study) -> None:
    assert study.runs[0].name == FIRST
    assert {run.start for run in study.measured} == {FIRST}
    assert study.measured == study.runs[1:]


def test_a_policy_is_one_preset_and_its_versions_are_seeds(study: Study) -> None:
    for policy in {run.policy for run in study.measured}:
        runs = [run for run in study.measured if run.policy == policy]
        assert len({run.preset for run in runs}) == 1
        assert len({run.seed for run in runs}) == len(runs)


def test_seek_and_its_twin_have_three_seeds() -> None:
    for policy in ("seek", "twin"):
        assert [run.seed for run in FULL.measured if run.policy == policy] == [0, 1, 2]


def test_the_tiny_study_has_a_task_of_each_category() -> None:
    assert set(TINY.tasks) <= set(SUITES["hide"])
    assert {str(load(task).category) for task in TINY.tasks} == {"RC", "HSR", "EPT"}


def test_the_tiny_study_trains_smaller_networks_of_the_same_kind(tmp_path: Path) -> None:
    for run in TINY.runs:
        path = tmp_path / "recipe.toml"
        path.write_text(recipe(TINY, run) or "")
        made, model = read(str(path)), preset(run.preset).model

        assert made.name == run.preset
        assert made.model.memory == model.memory
        assert made.model.clock == model.clock
        assert made.train.first.steps < 100


def test_the_full_study_trains_presets_as_they_are() -> None:
    assert {recipe(FULL, run) for run in FULL.runs} == {None}


def test_a_run_is_told_by_preset_seed_and_start() -> None:
    run = FULL.run("seek-s1")

    assert is_of(run, config_of(run, start="another/folder/first.safetensors"))
    assert not is_of(run, config_of(FULL.run("seek-s2")))
    assert not is_of(run, config_of(run, start=""))
    assert not is_of(run, config_of(FULL.run("twin-s1")))


def test_an_unknown_run_is_told_with_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"no run 'seek'; there are first, seek-s0"):
        FULL.run("seek")


def test_the_list_is_read_without_torch() -> None:
    program = (
        "import sys; import seek_model.study\n"
        "assert not {'torch', 'numba', 'pybullet'} & set(sys.modules)\n"
    )

    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)
