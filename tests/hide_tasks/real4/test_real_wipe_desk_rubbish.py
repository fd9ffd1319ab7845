"""What is special to the desk of the real robot: the rubbish hides the dirt."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.assets.sponge import DIRT
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import script

SPEC = suite.episode("real_wipe_desk_rubbish", "val", 0)


def brown(view):
    """How many pixels have the colour of dirt, in light or shade."""
    shares = view.rgb / np.maximum(view.rgb.sum(axis=-1, keepdims=True), 1)
    return int((np.abs(shares - np.array(DIRT) / sum(DIRT)).max(axis=-1) < 0.05).sum())


@pytest.mark.parametrize("place", ["left", "right"])
def test_removing_the_rubbish_reveals_the_dirt_and_wiping_removes_it(place):
    with World(suite.build(SPEC.twin({"rubbish": place}))) as world:
        seen = [brown(world.observe().views["front"])]
        for _, keyframe in script(world.task):
            world.execute(keyframe)
            seen.append(brown(world.observe().views["front"]))

        assert seen[0] <= 1 < 10 < seen[4]
        assert seen[-1] == 0
        assert (world.success, world.violations) == (True, [])


def test_the_rubbish_lies_where_the_variation_says():
    left, right = (suite.build(SPEC.twin({"rubbish": side})) for side in ("left", "right"))

    assert left.paper.at[1] > 0.05 > -0.05 > right.paper.at[1]
    assert [s.at.tolist() for s in left.layout.assets if s.links[0].name == "spot"] == [
        s.at.tolist() for s in right.layout.assets if s.links[0].name == "spot"
    ]


def test_rubbish_left_on_the_desk_is_not_placed():
    actions = [record.action for record in play(SPEC, Expert())[1]]
    result, _ = play(SPEC, Replay(actions[:2]))

    assert (result.success, result.failure) == (False, Failure.NOT_PLACED)
