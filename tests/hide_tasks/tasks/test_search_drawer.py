"""Searching drawers: one twice, an item not found, not put down, fallen."""

import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import pose
from tests.hide_tasks.tasks.doors import open_to

SPEC = suite.episode("search_drawer", "val", 0).twin({"item_in": "middle"})
MISS = 7  # keyframes of a search that finds nothing
REPEATED = (False, Failure.REPEATED_STEP)


@pytest.fixture(scope="module")
def actions():
    return [record.action for record in play(SPEC, Expert())[1]]


def verdict(*actions):
    result, _ = play(SPEC, Replay(actions))
    return result.success, result.failure


def test_searching_a_drawer_twice_is_a_repeated_step(actions):
    assert verdict(*actions[:MISS], *actions[:3], Stop()) == REPEATED


def test_before_the_item_is_found_it_is_unfinished_and_in_the_hand_it_is_not_placed(actions):
    assert verdict(*actions[:MISS], Stop()) == (False, Failure.UNFINISHED)
    assert verdict(*actions[:-1], Stop()) == (False, Failure.NOT_PLACED)


def test_a_look_into_a_drawer_counts_as_a_search():
    with World(suite.build(SPEC)) as world:
        world.step()
        open_to(world, world.task.chest["top"], 0.06)

        assert world.task.hidden_state()["searched"] == ["top"]


def test_an_item_beside_the_table_has_fallen():
    with World(suite.build(SPEC)) as world:
        world.task.item.body.place(pose(0.3, 1.2, 0.6))

        assert world.task.violations() == [Failure.DROPPED_OBJECT]
