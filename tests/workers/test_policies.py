import hashlib
import json
from pathlib import Path

import pytest

from hide_tasks import policies as builtin
from hide_tasks.contract import Stop
from hide_tasks.suite import episode
from seek_model import trained
from tests.workers import checkpoint_files
from tests.workers.test_run_folder import play
from workers import policies
from workers.policies import (
    Actions,
    BadPolicy,
    BuiltIn,
    ChangedCheckpoint,
    Checkpoint,
    Hosted,
    parse,
    read_checkpoint,
)


def test_the_built_in_policies_are_those_of_the_benchmark() -> None:
    assert (*policies.BUILTIN, *policies.DENSE) == builtin.BUILTIN


@pytest.mark.parametrize("name", builtin.BUILTIN)
def test_a_built_in_policy(name: str) -> None:
    assert parse(name) == BuiltIn(name)


@pytest.mark.parametrize("target", ["package.module:Mine", "some/where/mine.py:Mine"])
def test_a_researchers_own_class(target: str) -> None:
    assert parse(f"python:{target}") == Hosted(target)


@pytest.mark.parametrize(
    "text", ["", "experts", "python:", "python:module", "python::Mine", "replay:", "x:y"]
)
def test_anything_else_is_told_what_is_accepted(text: str) -> None:
    with pytest.raises(
        BadPolicy,
        match=r"expert, amnesiac, random, noop, expert-joint-position, expert-ee-delta, "
        r"replay:DIR .*replay:FILE.json .*python:module"
        r".*seek-small, sam2act-small .*path/to/file.safetensors",
    ):
        parse(text)


@pytest.mark.parametrize(("text", "meant"), [("amnesic", "amnesiac"), ("seek_small", "seek-small")])
def test_a_near_miss_is_told_the_nearest(text: str, meant: str) -> None:
    with pytest.raises(BadPolicy, match=f"Did you mean {meant}"):
        parse(text)


def test_a_replay_gives_each_episode_its_actions(tmp_path: Path) -> None:
    play(tmp_path, ("push_button_times", 0))
    replay = parse(f"replay:{tmp_path}")

    chosen = replay.for_episode(episode("push_button_times", "test", 0))

    assert isinstance(chosen, Actions)
    assert len(chosen.actions) == 2


@pytest.mark.parametrize(("split", "index"), [("test", 1), ("val", 0)])
def test_an_episode_without_recorded_actions(tmp_path: Path, split, index: int) -> None:
    play(tmp_path, ("push_button_times", 0))
    replay = parse(f"replay:{tmp_path}")

    with pytest.raises(BadPolicy, match=f"holds no actions of push_button_times-{split}-00{index}"):
        replay.for_episode(episode("push_button_times", split, index))


def test_a_folder_without_a_run_has_nothing_to_replay(tmp_path: Path) -> None:
    with pytest.raises(BadPolicy, match=r"nothing to replay: .* is no run's folder"):
        parse(f"replay:{tmp_path}")


def test_a_class_that_cannot_be_loaded_is_found_out_at_once() -> None:
    with pytest.raises(
        BadPolicy, match="python:nowhere:Mine cannot be loaded: ModuleNotFoundError"
    ):
        Hosted("nowhere:Mine").check()


def test_a_checkpoint_is_named_by_its_path_and_known_by_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = checkpoint_files.written(tmp_path / "seek.safetensors")

    chosen = parse("seek.safetensors")

    assert isinstance(chosen, Checkpoint)
    assert chosen.target == f"checkpoint:{path}"
    assert chosen.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("name", trained.POLICIES)
def test_a_trained_checkpoint_goes_by_its_name(tmp_path: Path, name: str) -> None:
    path = checkpoint_files.written(trained.path_of(name, tmp_path))

    assert parse(name, folder=tmp_path) == parse(str(path))


def test_a_trained_checkpoint_that_is_not_installed_is_told(tmp_path: Path) -> None:
    checkpoint_files.written(trained.path_of("seek-small", tmp_path))

    with pytest.raises(
        BadPolicy,
        match=r"sam2act-small\.safetensors is not installed \(here: seek-small\)\. Install .*"
        "hide train sam2act-small",
    ):
        parse("sam2act-small", folder=tmp_path)


def test_a_trained_checkpoint_that_is_damaged_is_told(tmp_path: Path) -> None:
    trained.path_of("seek-small", tmp_path).write_bytes(b"version https://git-lfs.github.com")

    with pytest.raises(BadPolicy, match=r"seek-small.safetensors is no checkpoint"):
        parse("seek-small", folder=tmp_path)


def test_what_both_were_trained_from_is_no_policy_to_name(tmp_path: Path) -> None:
    path = checkpoint_files.written(trained.path_of(trained.STAGE_ONE, tmp_path))

    with pytest.raises(BadPolicy, match="No policy 'stage-one'"):
        parse(trained.STAGE_ONE, folder=tmp_path)
    assert isinstance(parse(str(path)), Checkpoint)


def test_a_checkpoint_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(BadPolicy, match=r"No checkpoint .*: No such file or directory"):
        parse(f"{tmp_path}/seek.safetensors")


@pytest.mark.parametrize("wrong", checkpoint_files.WRONG)
def test_a_file_that_is_no_checkpoint(tmp_path: Path, wrong: str) -> None:
    content, message = checkpoint_files.WRONG[wrong]
    path = tmp_path / "seek.safetensors"
    path.write_bytes(content)

    with pytest.raises(BadPolicy, match=f"seek.safetensors is no checkpoint: .*{message}"):
        parse(str(path))


def test_weights_that_fit_no_network_are_found_out_at_once(tmp_path: Path) -> None:
    path = checkpoint_files.written(tmp_path / "seek.safetensors")

    with pytest.raises(BadPolicy, match=r"^seek.safetensors cannot be loaded: tensor '.*'"):
        read_checkpoint(path).check()


def test_without_torch_it_is_told_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = read_checkpoint(checkpoint_files.written(tmp_path / "seek.safetensors"))
    monkeypatch.setattr(policies, "has_torch", lambda: False)

    with pytest.raises(BadPolicy, match=r"pip install 'hide-seek\[seek\]'"):
        chosen.check()


def test_a_file_that_was_replaced_is_not_played(tmp_path: Path) -> None:
    chosen = read_checkpoint(checkpoint_files.written(tmp_path / "seek.safetensors"))
    checkpoint_files.written(tmp_path / "seek.safetensors", name="later")

    with pytest.raises(ChangedCheckpoint, match="was replaced; evaluate a copy"):
        chosen.make()
    with pytest.raises(BadPolicy, match="was replaced"):
        chosen.check()


def test_an_episodes_file_of_actions_is_replayed(tmp_path: Path) -> None:
    """And its own episode alone."""
    file = tmp_path / "actions.json"
    of_it = {"suite": "hide 1", "task": "reopen_drawer", "split": "val", "index": 3}
    came_to = {"rules": "hide", "policy": "mine", "scene_hash": None, "final_state_hash": None}
    file.write_text(json.dumps({**of_it, **came_to, "actions": [{"kind": "stop"}]}))

    replay = parse(f"replay:{file}")

    assert replay.for_episode(episode("reopen_drawer", "val", 3)) == Actions([Stop()])
    with pytest.raises(BadPolicy, match="holds no actions of reopen_drawer-val-002"):
        replay.for_episode(episode("reopen_drawer", "val", 2))


def test_another_document_has_nothing_to_replay(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("{}")

    with pytest.raises(BadPolicy, match=r"results.json holds no actions: suite Field required"):
        parse(f"replay:{tmp_path / 'results.json'}")
