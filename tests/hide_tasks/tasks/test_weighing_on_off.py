"""What goes wrong when weighing the pepper, by name."""

from functools import lru_cache

import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import script

LEFT = suite.episode("weighing_on_off", "val", 0).twin({"origin": "left"})
RIGHT = LEFT.twin({"origin": "right"})


@lru_cache
def recorded(origin):
    spec = LEFT.twin({"origin": origin})
    return tuple(record.action for record in play(spec, Expert())[1])


def test_the_container_that_it_came_from_is_a_wrong_recall():
    result, _ = play(LEFT, Replay([*recorded("left")[:8], *recorded("right")[8:]]))

    assert (result.success, result.failure) == (False, Failure.WRONG_RECALL)


def test_not_weighing_is_a_skipped_step():
    actions = recorded("left")
    result, _ = play(LEFT, Replay([*actions[:3], *actions[8:]]))

    assert (result.success, result.failure) == (False, Failure.SKIPPED_STEP)


def test_the_stage_is_the_one_of_the_next_keyframe():
    names, stages = [], []
    with World(suite.build(LEFT)) as world:
        for name, keyframe in script(world.task):
            world.execute(keyframe)
            names.append(name)
            stages.append(world.task.stage())

    assert stages[:-1] == names[1:]


def test_weighing_twice_is_a_repeated_step():
    actions = recorded("left")
    result, _ = play(LEFT, Replay([*actions[:8], *actions[3:]]))

    assert (result.success, result.failure) == (True, Failure.REPEATED_STEP)


@pytest.mark.parametrize(("done", "failure"), [(5, Failure.UNFINISHED), (8, Failure.NOT_PLACED)])
def test_stopping_early_has_a_name(done, failure):
    actions = recorded("left")
    result, _ = play(LEFT, Replay(actions[:done]))

    assert result.failure is failure


def test_what_is_still_held_on_the_scale_is_not_weighed():
    with World(suite.build(LEFT)) as world:
        for action in (
            *recorded("left")[:4],
            recorded("left")[4].model_copy(update={"opening": 0.0}),
        ):
            world.execute(action)
        for _ in range(480):
            world.step()

        assert world.task.scale.steady > 0
        assert not world.task.checks()["weighed"]


def test_the_needle_shows_the_weight_only_while_it_is_on_the_scale():
    shown = []
    with World(suite.build(LEFT)) as world:
        for action in recorded("left"):
            world.execute(action)
            shown.append(round(world.task.scale.shown, 2))

    assert shown[5] == pytest.approx(world.task.pepper.mass * 9.81, abs=0.02)
    assert shown[2] == shown[7] == 0


def test_a_pepper_under_the_table_is_dropped():
    with World(suite.build(LEFT)) as world:
        below = world.task.pepper.at.copy()
        below[2] = 0.3
        world.task.pepper.body.place(below)

        assert world.task.violations() == [Failure.DROPPED_OBJECT]
