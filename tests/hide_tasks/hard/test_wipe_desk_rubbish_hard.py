"""The place where the rubbish lay: only it is wiped, and nothing shows which it was."""

from functools import cache

import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.hard.wipe_desk_rubbish_hard import PLACES
from hide_tasks.policies import Expert, Replay

SPEC = suite.episode("wipe_desk_rubbish_hard", "val", 0)
IN_HAND = 6  # keyframes until the sponge is


@cache
def recorded(place):
    return tuple(r.action for r in play(SPEC.twin({"place": place}), Expert())[1])


def ending(actions):
    return [*actions[:-1], actions[-1].model_copy(update={"stop": True})]


@pytest.mark.parametrize(("lay", "wiped"), [("near", "middle"), ("far", "near")])
def test_wiping_another_place_is_a_wrong_recall_and_ends_it(lay, wiped):
    actions = [*recorded(lay)[:IN_HAND], *recorded(wiped)[IN_HAND:]]
    result, records = play(SPEC.twin({"place": lay}), Replay(actions))

    assert (result.success, result.failure) == (False, Failure.WRONG_RECALL)
    assert records[-1].hidden["wiped"] == [wiped]


def test_a_place_that_was_not_wiped_is_unfinished():
    result, _ = play(SPEC.twin({"place": "far"}), Replay(ending(recorded("far")[:IN_HAND])))

    assert (result.success, result.failure) == (False, Failure.UNFINISHED)


def test_a_stroke_wipes_its_place_and_no_film_of_another():
    for place in PLACES:
        with World(suite.build(SPEC.twin({"place": place}))) as world:
            for action in recorded(place):
                world.execute(action)
            left = {p: sum(not f.wiped for f in films) for p, films in world.task.films.items()}

        assert left == {p: 0 if p == place else len(world.task.films[p]) for p in PLACES}


def test_the_rubbish_lies_in_the_bin_in_one_pose_whatever_its_way():
    poses = set()
    for place in PLACES:
        with World(suite.build(SPEC.twin({"place": place}))) as world:
            for action in recorded(place)[:4]:
                world.execute(action)
            poses.add(tuple(world.task.paper.pose().tolist()))

    assert len(poses) == 1
