"""The bulb lights when it is screwed in, and goes out; what goes wrong has its name."""

import math
from functools import cache

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import quaternion
from hide_tasks.script import script

SPEC = suite.episode("light_bulb_in_out", "val", 0).twin({"origin": "left"})
INSERTED, SCREWED, TAKEN_OUT = 5, 6, 8  # keyframes done


@cache
def recorded(origin="left"):
    return [record.action for record in play(SPEC.twin({"origin": origin}), Expert())[1]]


def stopping(actions):
    return [*actions[:-1], actions[-1].model_copy(update={"stop": True})]


def test_the_light_is_on_while_the_screwed_bulb_is_in_the_lamp():
    lit = []
    with World(suite.build(SPEC)) as world:
        for _, keyframe in script(world.task):
            world.execute(keyframe)
            lit.append(world.task.bulb.lit)

    assert [done + 1 for done, on in enumerate(lit) if on] == [SCREWED, SCREWED + 1]


def test_both_holders_are_of_the_named_colour():
    one, two = suite.build(SPEC).holders.values()

    assert one.color == two.color == SPEC.variation["color"]


def test_the_holder_that_it_came_from_is_a_wrong_recall():
    result, _ = play(SPEC, Replay([*recorded()[:TAKEN_OUT], *recorded("right")[TAKEN_OUT:]]))

    assert (result.success, result.failure) == (False, Failure.WRONG_RECALL)


def test_moving_the_bulb_without_lighting_it_skips_a_step():
    actions = recorded()
    result, _ = play(SPEC, Replay([*actions[: INSERTED - 1], *actions[TAKEN_OUT:]]))

    assert (result.success, result.failure) == (False, Failure.SKIPPED_STEP)


def test_a_bulb_beside_its_thread_or_across_it_is_not_in_the_lamp():
    with World(suite.build(SPEC)) as world:
        lamp, bulb = world.task.lamp, world.task.bulb
        found = []
        for rotation in (quaternion(), quaternion(roll=math.pi / 2)):
            bulb.body.place(np.concatenate([lamp.seat[:3], rotation]))
            found.append(lamp.has(bulb))

        assert found == [True, False]


def test_lighting_it_twice_repeats_a_step():
    actions = recorded()
    again = actions[INSERTED - 1 : TAKEN_OUT]
    result, _ = play(SPEC, Replay([*actions[:TAKEN_OUT], *again, *actions[TAKEN_OUT:]]))

    assert (result.success, result.failure) == (True, Failure.REPEATED_STEP)


@pytest.mark.parametrize(
    ("done", "failure"), [(INSERTED, Failure.UNFINISHED), (SCREWED, Failure.NOT_PLACED)]
)
def test_stopping_on_the_way_is_named(done, failure):
    result, _ = play(SPEC, Replay(stopping(recorded()[:done])))

    assert (result.success, result.failure) == (False, failure)


def test_a_bulb_thrown_off_the_desk_is_dropped():
    approach, take, lift, *_ = recorded()
    behind = lift.model_copy(update={"position": (-0.50, 0.45, 1.10), "opening": 1.0})
    result, _ = play(SPEC, Replay([approach, take, lift, behind]))

    assert result.failure is Failure.DROPPED_OBJECT
