"""`hide train` as a user meets it, on demonstrations made without a simulator."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from seek_model.checkpoint_header import read_header
from server import training
from server.arguments import BadUsage
from tests.seek_model.stores import record
from tests.server.test_cli import hide

ROOT = Path(__file__).parents[2]
RECIPE = """
preset = "seek-small"
[model]
language = {channels = 16}
[model.views]
size = 16
points = 100
voxel = 0.05
[model.backbone]
widths = [8, 16]
channels = 16
depth = 1
heads = 2
[model.memory]
channels = 8
layers = 1
feedforward = 16
[train]
precision = "fp32"
validate_episodes = 1
first = {steps = 40, horizon = 40, warmup = 20, batch = 2}
second = {steps = 20, horizon = 20, warmup = 20, batch = 2, frames = 3}
"""


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(RECIPE)
    return path


@pytest.mark.slow
def test_a_training_from_demonstrations_to_checkpoint_and_again(
    capfd: pytest.CaptureFixture[str], recipe: Path, tmp_path: Path
) -> None:
    demos = record(tmp_path / "demos", {("press", "train"): [4, 6], ("press", "val"): [3]})
    out = tmp_path / "out"
    arguments = ("train", recipe, "--data", demos, "--out", out, "--steps-scale", "0.1")

    status, output, errors = hide(capfd, *arguments)

    assert (status, output) == (0, f"{out / 'checkpoint.safetensors'}\n")
    assert "Building" in errors
    assert ", first: 4 of 4 steps" in errors
    assert "cm off in 3 keyframes of split val" in errors
    assert read_header(out / "checkpoint.safetensors").config.name == "tiny"
    assert (demos / "keyframes-100-0.05" / "index.json").is_file()

    status, output, errors = hide(capfd, *arguments)

    assert (status, output) == (0, f"{out / 'checkpoint.safetensors'}\n")
    assert "Building" not in errors

    status, output, errors = hide(capfd, *arguments, "--no-resume")

    assert (status, output) == (2, "")
    assert f"{out} holds a training" in errors


@pytest.mark.slow
def test_a_second_phase_alone_with_a_seed_of_its_own(
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    recipe: Path,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    demos = record(tmp_path / "demos", {("press", "train"): [4, 6], ("press", "val"): [3]})
    arguments = ("train", recipe, "--data", demos, "--steps-scale", "0.1")
    status, output, _ = hide(capfd, *arguments)
    assert (status, output) == (0, "runs/train-tiny/checkpoint.safetensors\n")
    start = "runs/train-tiny/checkpoint-first.safetensors"

    status, output, errors = hide(capfd, *arguments, "--seed", "3", "--start", start)

    assert (status, output) == (0, "runs/train-tiny-s3/checkpoint.safetensors\n")
    assert "Phase first" not in errors
    header = read_header(Path(output.strip()))
    assert (header.config.train.seed, header.provenance.seed) == (3, 3)
    assert header.config.train.start == start


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("train", "Missing argument 'CONFIG'"),
        ("train seek-smal", "No preset 'seek-smal'. Did you mean seek-small?"),
        ("train none.toml", "none.toml: No such file"),
        ("train seek-small --data nowhere", "nowhere is no folder of demonstrations: no"),
        ("train seek-small --data .", ". is no folder of demonstrations: no demos.json"),
        ("train seek-small --steps-scale 0", "--steps-scale"),
        ("train seek-small --seed -1", "--seed"),
        ("train seek-small --start none", "--start none: no such file; it takes a checkpoint"),
    ],
)
def test_a_mistake_is_one_clear_line(
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: str,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)

    status, output, errors = hide(capfd, *arguments.split())

    assert (status, output) == (2, "")
    assert errors.startswith("hide: ")
    assert message in errors
    assert errors.count("\n") == 1


def test_a_task_without_demonstrations_is_told(
    capfd: pytest.CaptureFixture[str], recipe: Path, tmp_path: Path
) -> None:
    demos = record(tmp_path / "demos", {("press", "train"): [4]})
    recipe.write_text(RECIPE.replace("[train]", '[train]\ntasks = ["lift"]'))

    status, _, errors = hide(capfd, "train", recipe, "--data", demos, "--out", tmp_path / "out")

    assert status == 2
    assert "has no train episodes of lift; it has those of press" in errors
    assert not (tmp_path / "out").exists()


def test_a_training_that_diverges_is_told(
    capfd: pytest.CaptureFixture[str], recipe: Path, tmp_path: Path
) -> None:
    demos = record(tmp_path / "demos", {("press", "train"): [4]})
    recipe.write_text(RECIPE.replace("warmup = 20, batch", "warmup = 0, rate = 1e30, batch"))

    status, _, errors = hide(capfd, "train", recipe, "--data", demos, "--out", tmp_path / "out")

    assert status == 1
    assert "of phase first; what was saved before is kept" in errors


def test_without_torch_one_line_tells_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "NEEDED", ("no_such_package",))

    with pytest.raises(BadUsage, match=r"pip install 'hide-seek\[seek\]'"):
        training.require_torch()


def test_the_command_is_read_without_torch() -> None:
    program = (
        "import sys; from server import training\n"
        "assert training.configuration('seek-small').name == 'seek-small'\n"
        "assert not {'torch', 'numba', 'pybullet'} & set(sys.modules)\n"
    )

    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_a_validation_in_one_line() -> None:
    summary = json.loads(
        '{"frames": 7, "position_cm": 1.23, "position_near": 0.75, "rotation_degrees": 5.0,'
        ' "own_count": 0.5}'
    )

    assert training.told(summary) == (
        "1.2 cm off in 7 keyframes of split val, 75 % under 2 cm, 5 degrees, "
        "own count right in 50 %"
    )
