"""Playing once for every way in which choices fall gives what playing every time gives."""

from hide_tasks import suite
from hide_tasks.adversaries import CHOOSERS
from hide_tasks.amnesiac import Amnesiac
from hide_tasks.choices import Choices
from hide_tasks.episode import play
from hide_tasks.script import library

SPEC = suite.episode("push_button_times", "val", 0).twin({"count": 1})
ROLLS = 4


def test_each_way_is_played_once_and_ends_as_if_it_were_played_each_time():
    choices = Choices(SPEC, library(SPEC))
    policies = [Amnesiac({}), *(make({}) for make in CHOOSERS.values())]
    paths = []
    for policy in policies:
        policy.know(SPEC, choices.points)
        shared = [choices.play(policy) for _ in range(ROLLS)]
        policy.know(SPEC, choices.points)
        alone = [play(SPEC, policy)[0] for _ in range(ROLLS)]
        paths += shared

        for one, other in zip(shared, alone, strict=True):
            assert one.model_dump(exclude={"timing"}) == other.model_dump(exclude={"timing"})
    assert len({id(result) for result in paths}) == len(choices.results) < len(paths)


def test_without_a_choice_one_play_is_enough():
    spec = suite.episode("stack_cups_new", "val", 0)
    choices = Choices(spec, library(spec))
    policy = Amnesiac({})
    policy.know(spec, choices.points)

    assert [choices.play(policy).exact for _ in range(ROLLS)] == [True] * ROLLS
    assert (len(choices.results), choices.crossings) == (1, {})
