"""How many stages are done where: as the experts' scripts have it, and no older than they are."""

import pytest

from hide_tasks import ALL_TASKS, stages, suite
from hide_tasks.sources import sources_hash


@pytest.mark.parametrize("task", ALL_TASKS)
def test_the_file_is_of_the_present_sources(task: str) -> None:
    """Else: python -m hide_tasks.stages."""
    assert stages.read()[task]["sources"] == sources_hash(task)


@pytest.mark.parametrize("task", ALL_TASKS)
def test_every_history_is_known(task: str) -> None:
    assert list(stages.read()[task]["histories"]) == list(stages.examples(task))


def test_measuring_again_finds_the_same() -> None:
    spec = suite.episode("push_button_times", "val", 0)
    key = stages.history(spec.task, spec.variation)

    assert stages.moments(spec) == stages.read()[spec.task]["histories"][key]


def test_a_stage_that_changes_nothing_hidden_leaves_two_numbers() -> None:
    twice = {"count": 2, "color": "red"}

    def done(stage: str, presses: int) -> tuple[int, ...]:
        return stages.stages_done("push_button_times", twice, stage, {"presses_done": presses})

    assert done("reach", 0) == (0, 1)
    assert done("press", 1) == (1, 2)
    assert done("withdraw", 2) == (2, 3, 4)


def test_where_no_expert_comes_nothing_is_known() -> None:
    variation = {"count": 2, "color": "red"}

    assert not stages.stages_done("push_button_times", variation, "withdraw", {"presses_done": 3})
