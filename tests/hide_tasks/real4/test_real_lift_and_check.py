"""What is special to the blocks of the real robot: the one camera sees the piece."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Failure
from hide_tasks.episode import play
from hide_tasks.likeness import likeness
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import script

SPEC = suite.episode("real_lift_and_check", "val", 0)


def lifted(chip_under):
    """What is seen when the first block is in the air."""
    with World(suite.build(SPEC.twin({"chip_under": chip_under}))) as world:
        for (_, keyframe), _ in zip(script(world.task), range(3), strict=False):
            world.execute(keyframe)
        return world.observe()


def test_the_front_camera_tells_a_found_piece_from_an_empty_place():
    found, empty = lifted("first"), lifted("second")

    assert not likeness(found, empty).alike
    white = (found.views["front"].rgb > 200).all(axis=-1) & ~(empty.views["front"].rgb > 200).all(
        axis=-1
    )
    assert white.sum() > 82  # 0.5 % of the pixels: the tolerance of the certificates


def test_a_lying_block_hides_its_piece():
    observations = []
    for place in ("first", "third"):
        with World(suite.build(SPEC.twin({"chip_under": place}))) as world:
            observations.append(world.observe().views["front"])

    assert np.array_equal(observations[0].rgb, observations[1].rgb)
    assert np.array_equal(observations[0].depth, observations[1].depth)


@pytest.mark.parametrize(("place", "keyframes"), [("first", 6), ("second", 11), ("third", 16)])
def test_each_place_has_its_number_of_keyframes(place, keyframes):
    result, _ = play(SPEC.twin({"chip_under": place}), Expert())

    assert (result.exact, result.decisions) == (True, keyframes)


def test_a_search_that_stops_early_is_unfinished():
    spec = SPEC.twin({"chip_under": "second"})
    actions = [record.action for record in play(spec, Expert())[1]]
    result, _ = play(spec, Replay(actions[:5]))

    assert (result.success, result.failure) == (False, Failure.UNFINISHED)
