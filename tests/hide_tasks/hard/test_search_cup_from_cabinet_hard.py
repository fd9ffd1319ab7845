"""The order of the search is told: the other side first is a skipped step, twice a repeated one."""

import pytest

from hide_tasks import suite
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay

SPEC = suite.episode("search_cup_from_cabinet_hard", "val", 0)
MISS = 6  # keyframes of a search that finds nothing


def told(first, cup_on):
    return SPEC.twin({"first": first, "cup_on": cup_on})


def recorded(spec):
    return [record.action for record in play(spec, Expert())[1]]


@pytest.mark.parametrize("first", ["left", "right"])
def test_the_instruction_tells_which_side_comes_first(first):
    second = {"left": "right", "right": "left"}[first]
    text = suite.build(told(first, "left")).instruction

    assert 0 < text.index(f"the {first} side") < text.index(f"the {second} side")


def test_the_other_side_first_skips_a_step_also_if_the_cup_is_there():
    result, records = play(told("left", "right"), Replay(recorded(told("right", "right"))))

    assert (result.success, result.failure) == (False, Failure.SKIPPED_STEP)
    assert len(records) < 7  # it ended there


def test_the_first_side_again_repeats_a_step():
    spec = told("left", "right")
    actions = recorded(spec)
    result, _ = play(spec, Replay([*actions[:MISS], *actions[:3], Stop()]))

    assert (result.success, result.failure) == (False, Failure.REPEATED_STEP)
