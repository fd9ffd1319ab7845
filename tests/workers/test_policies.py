from pathlib import Path

import pytest

from hide_tasks import policies as builtin
from hide_tasks.suite import episode
from tests.workers.test_run_folder import play
from workers import policies
from workers.policies import Actions, BadPolicy, BuiltIn, Hosted, parse


def test_the_built_in_policies_are_those_of_the_benchmark() -> None:
    assert policies.BUILTIN == builtin.BUILTIN


@pytest.mark.parametrize("name", policies.BUILTIN)
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
        BadPolicy, match=r"expert, amnesiac, random, noop, replay:DIR .* python:module:Class"
    ):
        parse(text)


def test_a_near_miss_is_told_the_nearest() -> None:
    with pytest.raises(BadPolicy, match="Did you mean amnesiac"):
        parse("amnesic")


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
