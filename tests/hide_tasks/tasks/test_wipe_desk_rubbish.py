"""What goes wrong with rubbish and dirt has its name."""

from functools import cache

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.tasks.wipe_desk_rubbish import SPOTS

SPEC = suite.episode("wipe_desk_rubbish", "val", 0)


@cache
def recorded():
    return [record.action for record in play(SPEC, Expert())[1]]


def ending(actions):
    return [*actions[:-1], actions[-1].model_copy(update={"stop": True})]


def test_there_is_one_variation_and_nothing_hidden():
    task = suite.build(SPEC)

    assert len(task.variations) == 1
    assert not task.aliases() and not task.hidden_axes()


def test_rubbish_that_stays_on_the_desk_is_not_placed():
    result, _ = play(SPEC, Replay(ending(recorded()[:3])))

    assert (result.success, result.failure) == (False, Failure.NOT_PLACED)


def test_dirt_that_is_left_is_unfinished():
    result, records = play(SPEC, Replay(ending(recorded()[:7])))

    assert (result.success, result.failure) == (False, Failure.UNFINISHED)
    assert records[-1].hidden == {"rubbish_binned": True, "spots_left": SPOTS}


def test_wiping_before_the_rubbish_is_in_the_bin_skips_a_step():
    *_, approach, take, start, end, withdraw = recorded()
    result, _ = play(SPEC, Replay([approach, take, start, end, withdraw]))

    assert (result.success, result.failure) == (False, Failure.SKIPPED_STEP)


def test_rubbish_thrown_off_the_desk_is_dropped():
    approach, take, lift, *_ = recorded()
    behind = lift.model_copy(update={"position": (-0.50, 0.45, 1.10), "opening": 1.0})
    result, records = play(SPEC, Replay([approach, take, lift, behind]))

    assert (result.failure, len(records)) == (Failure.DROPPED_OBJECT, 4)


def test_a_sponge_in_the_air_leaves_the_dirt():
    *_, approach, take, start, end, _ = recorded()
    high = [
        step.model_copy(update={"position": (*step.position[:2], step.position[2] + 0.03)})
        for step in (start, end)
    ]
    with World(suite.build(SPEC)) as world:
        for action in (approach, take, *high):
            world.execute(action)

        assert world.task.sponge.left == SPOTS
