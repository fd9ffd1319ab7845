"""Searching the boxes: either order, a box searched twice, one shoe of two, a shoe that fell."""

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.poses import pose
from hide_tasks.script import script
from tests.hide_tasks.tasks.doors import open_to

SPEC = suite.episode("search_boxes", "val", 0)
LEFT, RIGHT = SPEC.twin({"shoes_in": "left"}), SPEC.twin({"shoes_in": "right"})
MISS, SHOE = 8, 5  # keyframes of a search that finds nothing, of a shoe
REPEATED = (False, False, Failure.REPEATED_STEP)


class Detour:
    """Searches the right box first."""

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


def test_the_right_box_may_be_searched_first():
    result, records = play(LEFT, Detour())

    assert (result.exact, len(records)) == (True, MISS + 15)


def test_searching_a_box_twice_is_a_repeated_step():
    actions = recorded(RIGHT)

    assert verdict(RIGHT, *actions[:MISS], *actions[:3], Stop()) == REPEATED


def test_before_the_shoes_are_found_it_is_unfinished_and_one_shoe_is_not_both():
    actions = recorded(RIGHT)

    assert verdict(RIGHT, *actions[:MISS], Stop()) == (False, False, Failure.UNFINISHED)
    assert verdict(RIGHT, *actions[:-SHOE], Stop()) == (False, False, Failure.NOT_PLACED)


def test_a_look_under_a_lid_counts_as_a_search():
    with World(suite.build(RIGHT)) as world:
        world.step()
        open_to(world, world.task.boxes["left"], 0.4)

        assert world.task.hidden_state()["searched"] == ["left"]


def test_a_shoe_beside_the_table_has_fallen():
    with World(suite.build(SPEC)) as world:
        world.task.shoes[0].body.place(pose(0.3, 1.2, 0.6))

        assert world.task.violations() == [Failure.DROPPED_OBJECT]
