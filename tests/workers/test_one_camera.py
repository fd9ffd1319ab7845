"""What plays, is recorded and is refused where a task is seen by one camera."""

import subprocess
import sys
from pathlib import Path

import pytest

from hide_tasks.contract import Observation
from hide_tasks.suite import episode
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.workers.remote.peers import answering
from workers.evaluation import LAYOUT, Evaluation, evaluate
from workers.fitness import is_of_another_suite, lacks_camera
from workers.policies import BadPolicy, read_checkpoint
from workers.preflight import made_up
from workers.recording_pictures import pictures
from workers.run_folder import RECORDINGS

ROOT = Path(__file__).parents[2]
TASK = "real_push_button_times"


def eval_command(policy: Path, task: str, out: Path) -> list[str]:
    what = ["--tasks", task, "--episodes", "1", "--no-recordings", "--out", str(out)]
    return [sys.executable, "-m", "server.cli", "eval", str(policy), *what]


def test_a_recording_has_the_pictures_of_the_cameras_that_are_there(tmp_path: Path) -> None:
    evaluate(Evaluation("expert", (TASK,), episodes=1), tmp_path / "run", workers=1)

    folder = tmp_path / "run" / RECORDINGS
    seen = pictures(folder / f"{episode(TASK, 'test', 0).name}.rrd")
    assert list(seen) == ["front"]
    assert b"wrist" not in (folder / LAYOUT).read_bytes()


def test_a_checkpoint_of_a_suite_plays_it_and_no_other(tmp_path: Path) -> None:
    file = tiny_checkpoint(tmp_path / "seek-x.safetensors", suite="real4")

    there = eval_command(file, TASK, tmp_path / "there")
    played = subprocess.run(there, cwd=ROOT, capture_output=True, text=True)
    elsewhere = eval_command(file, "push_button_times", tmp_path / "no")
    refused = subprocess.run(elsewhere, cwd=ROOT, capture_output=True, text=True)

    assert played.returncode == 0, played.stderr
    assert '"failure": "policy_error"' not in (tmp_path / "there" / "results.json").read_text()
    assert refused.returncode == 2
    assert refused.stderr.strip() == (
        "hide: seek-x was trained on suite real4; these tasks are of hide. "
        "Evaluate it on real4, or train one on demonstrations of hide."
    )
    assert not (tmp_path / "no").exists()


def test_a_map_with_a_camera_that_is_not_there_is_refused_before_it_is_asked(
    tmp_path: Path,
) -> None:
    maps, asked = tmp_path / "maps.toml", []
    maps.write_text('[observation]\nimage = {from = "wrist.rgb"}\n[action]\nkind = "action"\n')

    with answering(lambda message: asked.append(message) or {}) as url:
        wanted = Evaluation(url, (TASK,), episodes=1, recordings=False, maps=maps)
        with pytest.raises(BadPolicy, match=f"is to see the camera wrist, and {TASK} has front"):
            evaluate(wanted, tmp_path / "run", workers=1)

    assert asked == []


def test_reasons_are_empty_where_a_policy_fits() -> None:
    assert is_of_another_suite("seek", "hide", ["push_button_times"]) == ""
    assert lacks_camera("there", ["front"], [TASK, "push_button_times"]) == ""
    assert "has front alone" in lacks_camera("there", ["front", "wrist"], [TASK])


def test_what_a_checkpoint_is_tried_with_has_the_cameras_of_its_suite(tmp_path: Path) -> None:
    file = tiny_checkpoint(tmp_path / "seek-x.safetensors", suite="real4")

    seen: Observation = made_up(read_checkpoint(file).cameras)

    assert list(seen.views) == ["front"]
