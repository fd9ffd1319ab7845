"""The command as a user meets it: exit status, standard output, standard error."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hide_tasks import SUITES, suite
from hide_tasks.demos import Folder
from seek_model import trained
from server import cli
from tests.workers.test_run_folder import contents, play
from workers.sandbox.choice import Sandbox, best

ROOT = Path(__file__).parents[2]


def hide(capfd, *arguments: str | Path) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of a command, run in this process."""
    with pytest.raises(SystemExit) as exited:
        cli.main([str(argument) for argument in arguments])
    output = capfd.readouterr()
    return int(exited.value.code or 0), output.out, output.err


def test_the_catalogue_as_json(capfd) -> None:
    status, output, errors = hide(capfd, "tasks", "--json")

    entries = json.loads(output)["tasks"]
    assert (status, errors) == (0, "")
    assert [entry["name"] for entry in entries] == list(SUITES["hide"])
    assert {
        "category",
        "instruction",
        "variations",
        "keyframes",
        "hidden_state",
        "failures",
        "certificate",
    } <= set(entries[0])


def test_the_catalogue_as_a_table_names_every_task_whole(capfd) -> None:
    status, output, _ = hide(capfd, "tasks")

    assert status == 0
    assert all(name in output for name in SUITES["hide"])


def test_the_catalogue_is_there_within_a_second_and_without_the_simulator() -> None:
    program = (
        "import sys; from server import cli\n"
        "try: cli.main(['tasks'])\n"
        "except SystemExit as exited: assert exited.code == 0\n"
        "assert not {'pybullet', 'numba', 'torch', 'rerun'} & set(sys.modules)\n"
    )
    began = time.process_time(), os.times().children_user

    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL, cwd=ROOT)

    assert os.times().children_user - began[1] < 2.0  # of a processor that others use as well


@pytest.mark.parametrize("command", ["eval", "serve-policy"])
def test_help_names_the_trained_checkpoints(capfd, monkeypatch, command: str) -> None:
    monkeypatch.setenv("COLUMNS", "400")

    _, output, _ = hide(capfd, command, "--help")

    assert all(name in output for name in trained.POLICIES)


@pytest.mark.slow
@pytest.mark.skipif("seek-small" not in trained.there(), reason="seek-small did not come along")
def test_the_trained_checkpoint_plays_at_once(capfd, tmp_path: Path) -> None:
    asked = ("--tasks", "push_button_times", "--episodes", "1", "--json")

    status, output, errors = hide(capfd, "eval", "seek-small", *asked, "--out", tmp_path / "run")

    assert status == 0, errors
    [episode] = json.loads(output)["episodes"]
    assert episode["failure"] != "policy_error", episode["detail"]


@pytest.mark.parametrize("arguments", [[], ["--help"], ["eval", "--help"], ["tasks", "--help"]])
def test_help(capfd, arguments: list[str]) -> None:
    status, output, errors = hide(capfd, *arguments)

    assert (status, errors) == (0, "")
    assert "Usage: hide" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("fly", "No such command 'fly'"),
        ("eval", "Missing argument 'POLICY'"),
        (
            "eval exprt",
            "No policy 'exprt'. Did you mean expert? Policies: expert, amnesiac, random",
        ),
        ("eval seek-smal", "Did you mean seek-small? Policies: expert,"),
        ("serve-policy stage-on", "No policy 'stage-on'."),
        ("eval ws://", "'ws://' is no URL such as ws://host:8000"),
        ("eval ws://127.0.0.1:1", "ws://127.0.0.1:1 cannot be reached: Connection refused."),
        ("eval ws://me@host:1", "a URL has neither user, password nor fragment"),
        ("eval ws://host:1 --maps nowhere.toml", "nowhere.toml is no TOML file"),
        ("eval noop --maps nowhere.toml", "nowhere.toml declares a remote policy; 'noop' is none"),
        ("serve-policy nowhere.safetensors", "No checkpoint nowhere.safetensors"),
        ("serve-policy expert", "'expert' is not served"),
        ("serve-policy python:json:Mine", "cannot be loaded: AttributeError: json has no class"),
        ("serve-policy python:json:Mine --host 0.0.0.0", "set HIDE_POLICY_KEY to a secret"),
        (
            "eval expert --tasks serch_drawer",
            "No task 'serch_drawer'. Did you mean search_drawer? All: ",
        ),
        (
            "eval expert --tasks search_drawer --category RC",
            "--tasks and --category exclude each other",
        ),
        ("eval expert --tasks ,", "names no task; leave it out for all"),
        ("eval expert --category XX", "'XX' is not one of 'RC', 'HSR', 'EPT'"),
        ("eval expert --split best", "'best' is not one of 'train', 'val', 'test'"),
        ("eval expert --episodes 0", "--episodes 0: test has 25 a task; give 1 to 25"),
        ("eval expert --episodes 26", "--episodes 26: test has 25 a task; give 1 to 25"),
        ("eval expert --episodes many", "--episodes"),
        ("eval expert --index 25", "--index 25: test has none; give 0 to 24"),
        ("eval expert --index 3 --episodes 2", "--index and --episodes exclude each other"),
        ("eval replay:nowhere.json", "has nothing to replay: nowhere.json cannot be read"),
        ("eval expert --workers 0", "--workers"),
        ("eval expert --rules strict", "'strict' is not one of 'hide', 'parity'"),
        ("eval expert --fast", "No such option: --fast"),
        ("eval replay:nowhere", "replay:nowhere has nothing to replay: nowhere is no run's folder"),
        ("eval python:nowhere:Mine", "python:nowhere:Mine cannot be loaded: ModuleNotFoundError"),
        ("eval python:json:Mine", "cannot be loaded: AttributeError: json has no class Mine"),
        ("certify --tasks fly", "No task 'fly'."),
        ("demos", "Missing option '--out'"),
        ("demos --out d --tasks fly", "No task 'fly'."),
        ("demos --out d --format rlds", "'rlds' is not one of 'hide', 'lerobot'"),
        ("demos --out d --format lerobot --tasks fly", "No task 'fly'."),
        ("demos --out d --episodes 101", "--episodes 101: train has 100 a task; give 1 to 100"),
    ],
)
def test_a_mistake_is_one_clear_line(
    capfd, tmp_path: Path, monkeypatch, arguments: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)

    status, output, errors = hide(capfd, *arguments.split())

    assert (status, output) == (2, "")
    assert errors.startswith("hide: ")
    assert message in errors
    assert errors.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_something_else_is_left_alone(capfd, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter one")

    status, _, errors = hide(capfd, "eval", "noop", "--out", tmp_path)

    assert status == 2
    assert "holds something else (thesis.tex)" in errors
    assert contents(tmp_path) == {"thesis.tex": b"chapter one"}


@pytest.mark.parametrize(
    "arguments",
    [
        ["noop"],
        ["expert", "--split", "val"],
        ["expert", "--rules", "parity"],
        ["expert", "--index", "3"],
    ],
)
def test_the_folder_of_another_run_is_left_alone(
    capfd, tmp_path: Path, arguments: list[str]
) -> None:
    play(tmp_path, ("push_button_times", 0))
    before = contents(tmp_path)

    status, _, errors = hide(capfd, "eval", *arguments, "--out", tmp_path)

    assert status == 2
    assert "holds a run with" in errors
    assert contents(tmp_path) == before


def test_a_folder_that_cannot_be_written(capfd, tmp_path: Path) -> None:
    (tmp_path / "file").touch()

    status, _, errors = hide(capfd, "eval", "noop", "--out", tmp_path / "file" / "run")

    assert status == 2
    assert "cannot be written" in errors


def test_demonstrations_are_recorded_once(capfd, tmp_path: Path) -> None:
    task, first = "push_button_times", suite.episode("push_button_times", "val", 0)
    Folder.prepare(tmp_path, [task], "val").add(first)
    before = contents(tmp_path)
    asked = ("--tasks", task, "--split", "val", "--episodes", 2, "--workers", 1)

    status, output, errors = hide(capfd, "demos", "--out", tmp_path, *asked)

    after = contents(tmp_path)
    assert (status, output) == (0, "")
    assert "1 demonstration to record, 1 there" in errors
    assert "1 of 1 demonstrations" in errors
    assert before.items() <= after.items()
    assert set(after) - set(before) == {f"{task}/val-001.npz"}


def test_demonstrations_for_lerobot_are_recorded_once(capfd, tmp_path: Path) -> None:
    out = tmp_path / "set"
    asked = ("--format", "lerobot", "--tasks", "push_button_times", "--split", "val")
    command = ("demos", "--out", out, *asked, "--episodes", 1, "--workers", 1)

    status, output, errors = hide(capfd, *command)

    assert (status, output) == (0, "")
    assert "a LeRobotDataset of 1 episode\n" in errors
    before = contents(out)
    assert json.loads(before["meta/info.json"])["total_episodes"] == 1
    status, _, errors = hide(capfd, *command)
    assert status == 0
    assert "0 demonstrations to record, 1 there" in errors
    assert contents(out) == before


def test_what_is_there_is_no_place_for_lerobot(capfd, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter one")
    before = contents(tmp_path)

    status, output, errors = hide(capfd, "demos", "--out", tmp_path, "--format", "lerobot")

    assert (status, output) == (2, "")
    assert errors.startswith("hide: ")
    assert "holds something else" in errors
    assert contents(tmp_path) == before


def test_demonstrations_by_other_sources_are_left_alone(capfd, tmp_path: Path) -> None:
    asked = ("demos", "--out", tmp_path, "--tasks", "push_button_times")
    document = {"format": 1, "suite": "hide", "version": 1, "splits": ["train"]}
    index = json.dumps(document | {"sources": {"push_button_times": "0" * 64}})
    (tmp_path / "demos.json").write_text(index)
    older = tmp_path / "push_button_times" / "train-000.npz"
    older.parent.mkdir()
    older.touch()

    status, output, errors = hide(capfd, *asked)

    assert (status, output) == (2, "")
    assert "holds demonstrations of push_button_times by another version of the sources" in errors
    assert contents(tmp_path) == {
        "demos.json": index.encode(),
        "push_button_times/train-000.npz": b"",
    }


def test_the_doctor_finds_this_machine_fit(capfd) -> None:
    status, output, _ = hide(capfd, "doctor")

    assert "ok  packages: numpy" in output
    assert (f"ok  sandbox: {best()} is taken" in output) == (best() is not Sandbox.NONE)
    assert status == int(best() is Sandbox.NONE)


def test_a_reader_that_leaves_early_is_no_mistake() -> None:
    command = f"{sys.executable} -m server.cli tasks --json | head -c 10; exit ${{PIPESTATUS[0]}}"

    finished = subprocess.run(["bash", "-c", command], capture_output=True, text=True, cwd=ROOT)

    assert finished.stderr == ""
