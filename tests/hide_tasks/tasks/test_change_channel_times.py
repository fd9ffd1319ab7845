"""What goes wrong with the remote has its name; what is asked for is said in words."""

from functools import cache

import numpy as np
import pytest

from hide_tasks import load, suite
from hide_tasks.assets.remote import AHEAD, CAP_RISE, HEIGHT
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Keyframe
from hide_tasks.episode import play
from hide_tasks.motion.general import top_down
from hide_tasks.panda import FINGERTIP
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import point, pose
from hide_tasks.tasks.change_channel_times import PRESS

POINTING = 6  # keyframes until the remote points at the television


def twice(direction="up"):
    return suite.episode("change_channel_times", "val", 0).twin(
        {"direction": direction, "count": 2}
    )


@cache
def recorded(direction="up"):
    return [record.action for record in play(twice(direction), Expert())[1]]


@pytest.mark.parametrize(
    ("direction", "count", "text"),
    [
        ("up", 1, "turn the channel up once"),
        ("minus", 2, "turn the channel minus twice"),
        ("up", 3, "turn the channel up three times"),
    ],
)
def test_the_instruction_says_what_and_how_often(direction, count, text):
    task = load("change_channel_times")

    assert task.wording({"direction": direction, "count": count}) == text


def test_one_press_too_many_is_final():
    *start, hover, press, rise, again, rise_again, withdraw = recorded()
    actions = [*start, hover, press, rise, again, rise_again, press, rise, withdraw]
    result, records = play(twice(), Replay(actions))

    assert (result.success, result.failure) == (False, Failure.OVERCOUNT)
    assert len(records) == len(actions) - 2


def test_one_press_too_few_is_an_undercount():
    *start, hover, press, rise, _, _, withdraw = recorded()
    result, _ = play(twice(), Replay([*start, hover, press, rise, withdraw]))

    assert (result.success, result.failure) == (False, Failure.UNDERCOUNT)


def test_an_arm_that_stays_is_not_withdrawn():
    *actions, last, _ = recorded()
    stay = last.model_copy(update={"stop": True})
    result, _ = play(twice(), Replay([*actions, stay]))

    assert (result.success, result.failure) == (False, Failure.NOT_WITHDRAWN)


def test_the_other_button_is_the_wrong_object():
    up, minus = recorded("up"), recorded("minus")[POINTING : POINTING + 3]
    result, _ = play(twice("up"), Replay([*up[:POINTING], *minus, *up[POINTING:]]))

    assert (result.success, result.failure) == (True, Failure.WRONG_OBJECT)


def test_a_remote_that_was_not_laid_on_its_mat_is_not_placed():
    *_, withdraw = recorded()
    result, _ = play(twice(), Replay([withdraw]))

    assert (result.success, result.failure) == (False, Failure.NOT_PLACED)


def test_a_press_before_it_points_at_the_television_skips_a_step():
    cap = point(suite.build(twice()).remote.at, AHEAD["plus"], 0, HEIGHT / 2 + CAP_RISE)
    hover, press = (
        Keyframe.at(top_down(cap + np.array([0, 0, up])), opening=0.0, ignore_collisions=True)
        for up in (0.09, FINGERTIP - PRESS)
    )
    result, _ = play(twice(), Replay([hover, press, hover, *recorded()]))

    assert (result.success, result.failure) == (True, Failure.SKIPPED_STEP)


def test_a_remote_under_the_table_is_dropped():
    with World(suite.build(twice())) as world:
        world.task.remote.body.place(pose(0.3, 1.2, 0.6))

        assert Failure.DROPPED_OBJECT in world.task.violations()
    assert Failure.DROPPED_OBJECT in world.task.spoils


def test_a_pressed_remote_does_not_stir():
    spec = twice()
    _, records = play(spec, Expert())

    assert [record.hidden["presses_done"] for record in records[6:]] == [0, 1, 1, 2, 2, 2]
    assert all(record.checks["remote_points_at_television"] for record in records[4:])
