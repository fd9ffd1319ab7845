"""What goes wrong when pouring and putting back, by name."""

from functools import lru_cache

import numpy as np
import pytest

from hide_tasks import load, suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay

LEFT = suite.episode("pour_put_back", "val", 0).twin({"origin": "left"})


@lru_cache
def recorded(origin):
    return tuple(record.action for record in play(LEFT.twin({"origin": origin}), Expert())[1])


def test_there_are_the_papers_forty_variations():
    task = load("pour_put_back")
    named = {task.wording(variation) for variation in task.variations}

    assert (len(task.variations), len(named)) == (40, 20)
    assert task.wording({"color": "yellow"}).startswith(
        "pour liquid from the yellow cup to the cyan cup"
    )


def test_the_coaster_where_it_stood_is_a_wrong_recall():
    result, _ = play(LEFT, Replay([*recorded("left")[:6], *recorded("right")[6:]]))

    assert (result.success, result.failure) == (False, Failure.WRONG_RECALL)


def test_not_pouring_is_a_skipped_step():
    actions = recorded("left")
    result, _ = play(LEFT, Replay([*actions[:3], *actions[6:]]))

    assert (result.success, result.failure) == (False, Failure.SKIPPED_STEP)


def test_liquid_on_the_table_is_dropped_and_final():
    actions = recorded("left")
    beside = np.array([*actions[4].position, *actions[4].quaternion])
    beside[0] -= 0.15
    tipped = actions[4].at(beside, opening=0.0)
    result, records = play(LEFT, Replay([*actions[:4], tipped, *actions[5:]]))

    assert (result.success, result.failure) == (False, Failure.DROPPED_OBJECT)
    assert len(records) == 5


def test_liquid_in_a_cup_within_the_other_is_not_poured():
    with World(suite.build(LEFT)) as world:
        task = world.task
        apart = np.array(task.target.position) - task.source.position + [0, 0, 0.0155]
        for thing in (*task.droplets, task.source):
            thing.body.place(thing.pose() + np.array([*apart, 0, 0, 0, 0]))

        assert task._pour() == 0


def test_taking_the_other_cup_is_a_wrong_object():
    with World(suite.build(LEFT)) as world:
        task = world.task
        apart = np.array(task.target.position) - task.source.position
        for action in recorded("left")[:2]:
            moved = np.array(action.position) + apart
            world.execute(action.model_copy(update={"position": tuple(moved.tolist())}))

        assert world.violations == [Failure.WRONG_OBJECT]


@pytest.mark.parametrize(("done", "failure"), [(4, Failure.UNFINISHED), (6, Failure.NOT_PLACED)])
def test_stopping_early_has_a_name(done, failure):
    result, _ = play(LEFT, Replay(recorded("left")[:done]))

    assert result.failure is failure


def test_droplets_are_seen_only_outside_of_standing_cups():
    with World(suite.build(LEFT)) as world:
        task = world.task
        source, target = task.layout.assets[-2:]
        assert all(droplet.drawn(0) is None for droplet in task.droplets)
        assert (source.drawn(0) is None, target.drawn(0) is None) == (False, True)

        for action in recorded("left")[:5]:
            world.execute(action)
        assert (source.drawn(0) is None, target.drawn(0) is None) == (True, False)
