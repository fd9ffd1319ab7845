"""Searching the cabinet: either order, a side searched twice, a cup not put down or fallen."""

import numpy as np

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import pose
from hide_tasks.script import script
from tests.hide_tasks.tasks.doors import open_to

SPEC = suite.episode("search_cup_from_cabinet", "val", 0)
LEFT, RIGHT = SPEC.twin({"cup_on": "left"}), SPEC.twin({"cup_on": "right"})
MISS = 6  # keyframes of a search that finds nothing
REPEATED = (False, False, Failure.REPEATED_STEP)


class Detour:
    """Searches the right side first."""

    def bind(self, world, spec):
        self.script = script(world.task, 0)

    def reset(self, instruction, policy_seed):
        """The script is all it has."""

    def act(self, observation):
        return next(self.script)[1]


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


def verdict(spec, *actions):
    result, _ = play(spec, Replay(actions))
    return result.success, result.exact, result.failure


def test_the_right_side_may_be_searched_first():
    result, records = play(LEFT, Detour())

    assert (result.exact, len(records)) == (True, MISS + 8)


def test_searching_a_side_twice_is_a_repeated_step():
    actions = recorded(RIGHT)

    assert verdict(RIGHT, *actions[:MISS], *actions[:3], Stop()) == REPEATED


def test_before_the_cup_is_found_it_is_unfinished_and_in_the_hand_it_is_not_placed():
    actions = recorded(RIGHT)

    assert verdict(RIGHT, *actions[:MISS], Stop()) == (False, False, Failure.UNFINISHED)
    assert verdict(RIGHT, *actions[:-1], Stop()) == (False, False, Failure.NOT_PLACED)


def test_a_look_behind_a_door_counts_as_a_search():
    with World(suite.build(RIGHT)) as world:
        world.step()
        open_to(world, world.task.cabinet["left"], 0.06)

        assert world.task.hidden_state()["searched"] == ["left"]


def test_a_cup_on_the_ledge_is_not_out():
    with World(suite.build(RIGHT)) as world:
        cup = world.task.cup
        cup.body.place(cup.pose() - np.array([0.06, 0, 0, 0, 0, 0, 0]))

        assert not world.task.checks()["cup_outside"]


def test_a_cup_beside_the_table_has_fallen():
    with World(suite.build(SPEC)) as world:
        world.task.cup.body.place(pose(0.3, 1.2, 0.6))

        assert world.task.violations() == [Failure.DROPPED_OBJECT]
